/* Steps of a reduced model (model.h): machine code from the object file steps.o, which defines
   sparsemor_step and sparsemor_read, on a copy of the data in data.bin. sizes.h says their sizes. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"
#include "sizes.h"

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

struct Model {
    double *reals, *u, *y; /* u: changes of the inputs from their first values */
    int64_t *integers;
    uint8_t *flags;
    int64_t steps, failed;
    int read;
};
static const char *const names[] = {NAMES NULL};

void model_reset(Model *m) {
    const double *table = sparsemor_data + REALS;
    const int64_t *integers = (const int64_t *)(table + (size_t)ROWS * COLUMNS);
    memcpy(m->reals, sparsemor_data, REALS * sizeof(double));
    memcpy(m->integers, integers, INTEGERS * sizeof(int64_t));
    memcpy(m->flags, integers + INTEGERS, FLAGS);
    memset(m->u, 0, INPUTS * sizeof(double));
    m->steps = m->failed = m->read = 0;
}

void model_free(Model *m) {
    if (!m) return;
    free(m->reals); free(m->integers); free(m->flags); free(m->u); free(m->y); free(m);
}

Model *model_new(void) {
    Model *m = calloc(1, sizeof(Model));
    if (!m) return NULL;
    m->reals = malloc((REALS + 1) * sizeof(double));
    m->integers = malloc((INTEGERS + 1) * sizeof(int64_t));
    m->flags = malloc(FLAGS + 1);
    m->u = malloc((INPUTS + 1) * sizeof(double));
    m->y = malloc((OUTPUTS + 1) * sizeof(double));
    if (!m->reals || !m->integers || !m->flags || !m->u || !m->y) {
        model_free(m);
        return NULL;
    }
    model_reset(m);
    return m;
}

unsigned model_inputs(void) { return INPUTS; }
unsigned model_outputs(void) { return OUTPUTS; }
const char *model_name(unsigned k) { return k < INPUTS + OUTPUTS ? names[k] : NULL; }
double model_step_size(void) { return STEP; }
double model_time(const Model *m) { return m->steps * STEP; }

int model_set(Model *m, unsigned input, double value) {
    if (input >= INPUTS || !isfinite(value)) return 1;
    m->u[input] = value - FIRST[input];
    return 0;
}

double model_get(Model *m, unsigned k) {
    if (k < INPUTS) return FIRST[k] + m->u[k];
    if (!m->read) sparsemor_read(m->reals, m->integers, m->flags, m->y);
    m->read = 1;
    return k < INPUTS + OUTPUTS ? m->y[k - INPUTS] : NAN;
}

int model_step(Model *m) {
    const double *row = sparsemor_data + REALS + (size_t)m->steps * COLUMNS;
    if (m->failed) return MODEL_FAILED;
    if (ROWS && m->steps >= ROWS) return MODEL_ENDS;
    m->read = 0;
    if (!sparsemor_step(m->reals, m->integers, m->flags, row, m->u)) {
        m->failed = 1;
        return MODEL_NOT_CONVERGED;
    }
    m->steps++;
    return 0;
}

/* state: steps, failed, inputs, reals, integers, flags */
size_t model_state_size(void) {
    return 16 + 8 * ((size_t)INPUTS + REALS + INTEGERS) + FLAGS;
}
static char *moved(char *at, void *own, size_t size, int out) {
    if (out) memcpy(at, own, size); else memcpy(own, at, size);
    return at + size;
}
static void exchanged(Model *m, char *at, int out) {
    at = moved(at, &m->steps, 8, out);
    at = moved(at, &m->failed, 8, out);
    at = moved(at, m->u, 8 * (size_t)INPUTS, out);
    at = moved(at, m->reals, 8 * (size_t)REALS, out);
    at = moved(at, m->integers, 8 * (size_t)INTEGERS, out);
    moved(at, m->flags, FLAGS, out);
    m->read = 0;
}
void model_save(Model *m, void *state) { exchanged(m, state, 1); }
void model_restore(Model *m, const void *state) { exchanged(m, (char *)state, 0); }

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
