/* Takes steps with the first values of the inputs and prints the outputs as CSV:
   cc -O2 example.c model.c steps.o -lm -o example && ./example 100 */
#include <stdio.h>
#include <stdlib.h>
#include "model.h"

int main(int count, char *words[]) {
    int steps = count > 1 ? atoi(words[1]) : 100, end = 0;
    unsigned first = model_inputs(), all = first + model_outputs();
    Model *m = model_new();
    if (!m) return 1;
    printf("time");
    for (unsigned k = first; k < all; k++) printf(",%s", model_name(k));
    printf("\n");
    for (int i = 0; i <= steps && !end; i++) {
        printf("%.17g", model_time(m));
        for (unsigned k = first; k < all; k++) printf(",%.17g", model_get(m, k));
        printf("\n");
        if (i < steps) end = model_step(m);
    }
    if (end) fprintf(stderr, "step fails: %d (model.h)\n", end);
    model_free(m);
    return end;
}
