/* FMI 2.0 for co-simulation (fmi-standard.org) of a reduced model (model.c). */
#include <stdio.h>
#include "model.c"

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

typedef int Status; /* 0 OK, 1 warning, 2 discard, 3 error, 4 fatal, 5 pending */
typedef struct {
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;
typedef struct {
    Model *model;
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *environment;
    char *name;
} Unit;

static Status failed(Unit *c, const char *what) {
    if (c->log) c->log(c->environment, c->name, 3, "logStatusError", "%s", what);
    return 3;
}

static void release(Unit *c) {
    if (!c) return;
    model_free(c->model);
    free(c->name);
    free(c);
}

PUBLIC const char *fmi2GetTypesPlatform(void) { return "default"; }
PUBLIC const char *fmi2GetVersion(void) { return "2.0"; }
PUBLIC Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const categories[]) {
    (void)c; (void)on; (void)n; (void)categories;
    return 0;
}

PUBLIC void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                             const Callbacks *calls, int visible, int logging) {
    Unit *c;
    (void)resources; (void)visible; (void)logging;
    if (kind != 1 || !guid || strcmp(guid, GUID)) {
        if (calls && calls->log)
            calls->log(calls->environment, name, 3, "logStatusError", "%s",
                       kind != 1 ? "only co-simulation" : "the GUID is that of another model");
        return NULL;
    }
    if (!(c = calloc(1, sizeof(Unit)))) return NULL;
    c->model = model_new();
    c->name = malloc(strlen(name ? name : "") + 1);
    if (!c->model || !c->name) {
        release(c);
        return NULL;
    }
    strcpy(c->name, name ? name : "");
    c->log = calls ? calls->log : NULL;
    c->environment = calls ? calls->environment : NULL;
    return c;
}

PUBLIC void fmi2FreeInstance(void *c) { release(c); }
PUBLIC Status fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start, int ends,
                                  double stop) {
    (void)tolerant; (void)tolerance; (void)ends; (void)stop;
    return start == 0.0 ? 0 : failed(c, "the model starts at 0 s");
}
PUBLIC Status fmi2EnterInitializationMode(void *c) { (void)c; return 0; }
PUBLIC Status fmi2ExitInitializationMode(void *c) { (void)c; return 0; }
PUBLIC Status fmi2Terminate(void *c) { (void)c; return 0; }
PUBLIC Status fmi2Reset(void *c) {
    model_reset(((Unit *)c)->model);
    return 0;
}

PUBLIC Status fmi2GetReal(void *c, const unsigned r[], size_t n, double value[]) {
    for (size_t k = 0; k < n; k++) {
        if (r[k] >= INPUTS + OUTPUTS) return failed(c, "there is no variable with this reference");
        value[k] = model_get(((Unit *)c)->model, r[k]);
    }
    return 0;
}

PUBLIC Status fmi2SetReal(void *c, const unsigned r[], size_t n, const double value[]) {
    for (size_t k = 0; k < n; k++) {
        if (r[k] >= INPUTS) return failed(c, "only inputs can be set");
        if (model_set(((Unit *)c)->model, r[k], value[k]))
            return failed(c, "an input must be finite");
    }
    return 0;
}

PUBLIC Status fmi2DoStep(void *c, double t, double size, int keep) {
    static const char *const why[] = {
        "", "the step does not converge", "the functions of time of the model end here",
        "an earlier step has failed: reset or restore a state"};
    double count = floor(size / STEP + 0.5);
    (void)t; (void)keep;
    if (!(count >= 1.0) || fabs(size - count * STEP) > 1e-6 * STEP)
        return failed(c, "a communication step must be a multiple of the model's step");
    for (int64_t k = 0; k < (int64_t)count; k++) {
        int end = model_step(((Unit *)c)->model);
        if (end) return failed(c, why[end]);
    }
    return 0;
}

PUBLIC Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *size) {
    (void)c; (void)state;
    *size = model_state_size();
    return 0;
}
PUBLIC Status fmi2SerializeFMUstate(void *c, void *state, char bytes[], size_t size) {
    (void)c;
    if (size < model_state_size()) return 3;
    memcpy(bytes, state, model_state_size());
    return 0;
}
PUBLIC Status fmi2DeSerializeFMUstate(void *c, const char bytes[], size_t size, void **state) {
    if (size != model_state_size()) return failed(c, "this is no state of the model");
    if (!*state && !(*state = malloc(size))) return failed(c, "no memory");
    memcpy(*state, bytes, size);
    return 0;
}
PUBLIC Status fmi2GetFMUstate(void *c, void **state) {
    if (!*state && !(*state = malloc(model_state_size()))) return failed(c, "no memory");
    model_save(((Unit *)c)->model, *state);
    return 0;
}
PUBLIC Status fmi2SetFMUstate(void *c, void *state) {
    model_restore(((Unit *)c)->model, state);
    return 0;
}
PUBLIC Status fmi2FreeFMUstate(void *c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return 0;
}

#define NONE(name, type) \
    PUBLIC Status name(void *c, const unsigned r[], size_t n, type value[]) { \
        (void)r; (void)value; \
        return n ? failed(c, "all variables are real") : 0; \
    }
NONE(fmi2GetInteger, int)
NONE(fmi2SetInteger, const int)
NONE(fmi2GetBoolean, int)
NONE(fmi2SetBoolean, const int)
NONE(fmi2GetString, const char *)
NONE(fmi2SetString, const char *const)
PUBLIC Status fmi2GetDirectionalDerivative(void *c, const unsigned a[], size_t n, const unsigned b[],
                                           size_t k, const double dx[], double dy[]) {
    (void)a; (void)n; (void)b; (void)k; (void)dx; (void)dy;
    return failed(c, "there are no directional derivatives");
}
PUBLIC Status fmi2SetRealInputDerivatives(void *c, const unsigned r[], size_t n, const int order[],
                                          const double value[]) {
    (void)r; (void)n; (void)order; (void)value;
    return failed(c, "inputs are held during a step");
}
PUBLIC Status fmi2GetRealOutputDerivatives(void *c, const unsigned r[], size_t n, const int order[],
                                           double value[]) {
    (void)r; (void)n; (void)order; (void)value;
    return failed(c, "outputs have no derivatives");
}
PUBLIC Status fmi2CancelStep(void *c) { return failed(c, "steps are done at once"); }
PUBLIC Status fmi2GetStatus(void *c, int kind, Status *value) { (void)c; (void)kind; *value = 0; return 2; }
PUBLIC Status fmi2GetRealStatus(void *c, int kind, double *value) {
    if (kind != 2) return 2;
    *value = model_time(((Unit *)c)->model);
    return 0;
}
PUBLIC Status fmi2GetIntegerStatus(void *c, int kind, int *value) { (void)c; (void)kind; (void)value; return 2; }
PUBLIC Status fmi2GetBooleanStatus(void *c, int kind, int *value) { (void)c; (void)kind; (void)value; return 2; }
PUBLIC Status fmi2GetStringStatus(void *c, int kind, const char **value) { (void)c; (void)kind; (void)value; return 2; }
