/* FMI 2.0 for co-simulation (fmi-standard.org) of a reduced model: its steps are the object file that
   sparsemor_step and sparsemor_read come from, its data the file data.bin. model.h says their sizes. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif
#if defined(__APPLE__)
#define DATA ".const_data"
#define NAME "_sparsemor_data"
#elif defined(_WIN32)
#define DATA ".section .rdata,\"dr\""
#define NAME "sparsemor_data"
#else
#define DATA ".section .rodata"
#define NAME "sparsemor_data"
#endif
__asm__(DATA "\n.balign 16\n.globl " NAME "\n" NAME ":\n.incbin \"data.bin\"\n.text\n");
extern const double sparsemor_data[]; /* reals, table, integers, flags */

int64_t sparsemor_step(double *f, int64_t *i, uint8_t *b, const double *t, const double *u);
int64_t sparsemor_read(double *f, int64_t *i, uint8_t *b, double *y);

typedef struct {
    double *reals, *u, *y;
    int64_t *integers;
    uint8_t *flags;
    int64_t steps;
    int read, failed;
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *environment;
    char *name;
} Model;
typedef int Status; /* 0 OK, 1 warning, 2 discard, 3 error, 4 fatal, 5 pending */
typedef struct {
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

static Status failed(Model *m, const char *what) {
    if (m->log) m->log(m->environment, m->name, 3, "logStatusError", "%s", what);
    return 3;
}

static void begin(Model *m) {
    const double *table = sparsemor_data + REALS;
    const int64_t *integers = (const int64_t *)(table + (size_t)ROWS * COLUMNS);
    memcpy(m->reals, sparsemor_data, REALS * sizeof(double));
    memcpy(m->integers, integers, INTEGERS * sizeof(int64_t));
    memcpy(m->flags, integers + INTEGERS, FLAGS);
    memset(m->u, 0, INPUTS * sizeof(double));
    m->steps = m->read = m->failed = 0;
}

static void release(Model *m) {
    if (!m) return;
    free(m->reals); free(m->integers); free(m->flags); free(m->u); free(m->y); free(m->name);
    free(m);
}

PUBLIC const char *fmi2GetTypesPlatform(void) { return "default"; }
PUBLIC const char *fmi2GetVersion(void) { return "2.0"; }
PUBLIC Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const categories[]) {
    (void)c; (void)on; (void)n; (void)categories;
    return 0;
}

PUBLIC void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                             const Callbacks *calls, int visible, int logging) {
    Model *m;
    (void)resources; (void)visible; (void)logging;
    if (kind != 1 || !guid || strcmp(guid, GUID)) {
        if (calls && calls->log)
            calls->log(calls->environment, name, 3, "logStatusError", "%s",
                       kind != 1 ? "only co-simulation" : "the GUID is that of another model");
        return NULL;
    }
    if (!(m = calloc(1, sizeof(Model)))) return NULL;
    m->reals = malloc((REALS + 1) * sizeof(double));
    m->integers = malloc((INTEGERS + 1) * sizeof(int64_t));
    m->flags = malloc(FLAGS + 1);
    m->u = malloc((INPUTS + 1) * sizeof(double));
    m->y = malloc((OUTPUTS + 1) * sizeof(double));
    m->name = malloc(strlen(name ? name : "") + 1);
    if (!m->reals || !m->integers || !m->flags || !m->u || !m->y || !m->name) {
        release(m);
        return NULL;
    }
    strcpy(m->name, name ? name : "");
    m->log = calls ? calls->log : NULL;
    m->environment = calls ? calls->environment : NULL;
    begin(m);
    return m;
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
PUBLIC Status fmi2Reset(void *c) { begin(c); return 0; }

PUBLIC Status fmi2GetReal(void *c, const unsigned r[], size_t n, double value[]) {
    Model *m = c;
    for (size_t k = 0; k < n; k++) {
        if (r[k] >= INPUTS + OUTPUTS) return failed(m, "there is no variable with this reference");
        if (r[k] < INPUTS) {
            value[k] = FIRST[r[k]] + m->u[r[k]];
            continue;
        }
        if (!m->read) sparsemor_read(m->reals, m->integers, m->flags, m->y);
        m->read = 1;
        value[k] = m->y[r[k] - INPUTS];
    }
    return 0;
}

PUBLIC Status fmi2SetReal(void *c, const unsigned r[], size_t n, const double value[]) {
    Model *m = c;
    for (size_t k = 0; k < n; k++) {
        if (r[k] >= INPUTS) return failed(m, "only inputs can be set");
        if (!isfinite(value[k])) return failed(m, "an input must be finite");
        m->u[r[k]] = value[k] - FIRST[r[k]];
    }
    return 0;
}

PUBLIC Status fmi2DoStep(void *c, double t, double size, int keep) {
    Model *m = c;
    double count = floor(size / STEP + 0.5);
    (void)t; (void)keep;
    if (m->failed) return failed(m, "an earlier step has failed: reset or restore a state");
    if (!(count >= 1.0) || fabs(size - count * STEP) > 1e-6 * STEP)
        return failed(m, "a communication step must be a multiple of the model's step");
    for (int64_t k = 0; k < (int64_t)count; k++) {
        if (ROWS && m->steps >= ROWS)
            return failed(m, "the functions of time of the model end here");
        const double *row = sparsemor_data + REALS + (size_t)m->steps * COLUMNS;
        m->read = 0;
        if (!sparsemor_step(m->reals, m->integers, m->flags, row, m->u)) {
            m->failed = 1;
            return failed(m, "the step does not converge");
        }
        m->steps++;
    }
    return 0;
}

/* state: steps, failed, inputs, reals, integers, flags */
#define SIZE (16 + 8 * ((size_t)INPUTS + REALS + INTEGERS) + FLAGS)
PUBLIC Status fmi2SerializeFMUstate(void *c, void *state, char bytes[], size_t size) {
    (void)c;
    if (size < SIZE) return 3;
    memcpy(bytes, state, SIZE);
    return 0;
}
PUBLIC Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *size) {
    (void)c; (void)state;
    *size = SIZE;
    return 0;
}
PUBLIC Status fmi2DeSerializeFMUstate(void *c, const char bytes[], size_t size, void **state) {
    if (size != SIZE) return failed(c, "this is no state of the model");
    if (!*state && !(*state = malloc(SIZE))) return failed(c, "no memory");
    memcpy(*state, bytes, SIZE);
    return 0;
}
static char *moved(char *at, void *own, size_t size, int out) {
    if (out) memcpy(at, own, size); else memcpy(own, at, size);
    return at + size;
}
static Status exchanged(Model *m, char *at, int out) {
    int64_t bad = m->failed;
    at = moved(at, &m->steps, 8, out);
    at = moved(at, &bad, 8, out);
    at = moved(at, m->u, 8 * (size_t)INPUTS, out);
    at = moved(at, m->reals, 8 * (size_t)REALS, out);
    at = moved(at, m->integers, 8 * (size_t)INTEGERS, out);
    moved(at, m->flags, FLAGS, out);
    m->failed = (int)bad;
    m->read = 0;
    return 0;
}
PUBLIC Status fmi2GetFMUstate(void *c, void **state) {
    if (!*state && !(*state = malloc(SIZE))) return failed(c, "no memory");
    return exchanged(c, *state, 1);
}
PUBLIC Status fmi2SetFMUstate(void *c, void *state) { return exchanged(c, state, 0); }
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
    *value = ((Model *)c)->steps * STEP;
    return 0;
}
PUBLIC Status fmi2GetIntegerStatus(void *c, int kind, int *value) { (void)c; (void)kind; (void)value; return 2; }
PUBLIC Status fmi2GetBooleanStatus(void *c, int kind, int *value) { (void)c; (void)kind; (void)value; return 2; }
PUBLIC Status fmi2GetStringStatus(void *c, int kind, const char **value) { (void)c; (void)kind; (void)value; return 2; }

/* What numba's code calls: memory of arrays, and products of matrices. */
typedef struct {
    size_t references;
    void *destroy, *info, *data;
    size_t size;
    void *allocator;
} Memory;
static void *allocated(size_t size, size_t align) {
    char *raw = malloc(sizeof(Memory) + size + align);
    Memory *m = (Memory *)raw;
    uintptr_t first;
    if (!raw) abort();
    first = ((uintptr_t)raw + sizeof(Memory) + align - 1) / align * align;
    memset(m, 0, sizeof(Memory));
    m->references = 1;
    m->data = (void *)first;
    m->size = size;
    return m;
}
void *NRT_MemInfo_alloc_aligned(size_t size, unsigned align) { return allocated(size, align); }
void *NRT_MemInfo_alloc(size_t size) { return allocated(size, 16); }
void NRT_MemInfo_call_dtor(void *m) { free(m); }
void *NRT_Allocate(size_t size) { return malloc(size); }
void NRT_Free(void *m) { free(m); }
int numba_xxgemv(char kind, char transposed, size_t m, size_t n, void *alpha, void *A, size_t lda,
                 void *x, void *beta, void *y) {
    double a = *(double *)alpha, b = *(double *)beta, *out = y;
    const double *matrix = A, *vector = x;
    int turned = transposed == 't' || transposed == 'T';
    (void)kind;
    for (size_t i = 0; i < (turned ? n : m); i++) out[i] = b == 0.0 ? 0.0 : b * out[i];
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < m; i++)
            out[turned ? j : i] += a * matrix[i + j * lda] * vector[turned ? i : j];
    return 0;
}
int numba_attempt_nocopy_reshape(intptr_t nd, const intptr_t *dims, const intptr_t *strides,
                                 intptr_t newnd, const intptr_t *newdims, intptr_t *newstrides,
                                 intptr_t itemsize, int fortran) {
    (void)nd; (void)dims; (void)strides; (void)fortran;
    for (intptr_t k = newnd - 1, size = itemsize; k >= 0; size *= newdims[k--]) newstrides[k] = size;
    return 1; /* all arrays are contiguous */
}
