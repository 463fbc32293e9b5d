/* The discrete equations at an instant (`discrete.c`), for what happens there (`events.c`). */

#ifndef LMOC_DISCRETE_H
#define LMOC_DISCRETE_H

#include "fmu.h"

enum { GT, GE, FLOOR };  /* how relations are decided */
enum { FMU_ROUNDS = 100, FMU_BEGUN = FMU_ROUNDS, FMU_BEFORE };  /* places in the history behind what has been there */

static inline double near_to(double t) { return 4e-15 * fmax(fabs(t), 1e-300); }
static inline int differ(double a, double b) { return a != b && !(a != a && b != b); }

int fmu_rounded(const fmu_events *e, int64_t zero);     /* a function whose whole part counts, not its sign */
double fmu_height(const fmu_events *e, int64_t zero, double value);  /* its distance from zero, or a whole number */
double fmu_value(const fmu *f, int64_t zero);           /* as last looked at */
double fmu_decided(const fmu *f, int64_t zero, double now);  /* the relation, from where it is now */
double *fmu_in_history(fmu *f, int64_t k);
int fmu_unsettled(fmu *f);
int fmu_take(fmu *f, double t, const double *x);        /* the continuous values at a place */
void fmu_remember(fmu *f);                              /* pre(v) := v */
void fmu_assign(fmu *f);                                /* the discrete equations once, in their order */
void fmu_run(fmu *f, int tape);                         /* a tape for the present discrete values */
int fmu_settle(fmu *f, const double *x);                /* discrete values that agree with the continuous ones */

#endif
