/* A reduced model whose steps are machine code: a copy of its state, inputs, and outputs. Units are
   SI. Functions may be called by several threads, each with a model of its own. */
#ifndef MODEL_H
#define MODEL_H
#include <stddef.h>

typedef struct Model Model;
enum { MODEL_NOT_CONVERGED = 1, MODEL_ENDS = 2, MODEL_FAILED = 3 };

Model *model_new(void); /* at time 0; NULL without memory */
void model_free(Model *);
void model_reset(Model *); /* back to time 0, inputs to their first values */

unsigned model_inputs(void);
unsigned model_outputs(void);
const char *model_name(unsigned k); /* inputs have the first numbers, then come the outputs */
double model_step_size(void);       /* s */

int model_set(Model *, unsigned input, double value); /* held until it is set again; 0, else refused */
int model_step(Model *); /* 0, or why the state has not advanced: the iteration does not converge, the
                            functions of time that are no inputs end here, an earlier step has failed */
double model_get(Model *, unsigned k); /* present value of an input or output */
double model_time(const Model *);      /* s */

size_t model_state_size(void); /* bytes of a saved state */
void model_save(Model *, void *state);
void model_restore(Model *, const void *state); /* one of the same model and program */
#endif
