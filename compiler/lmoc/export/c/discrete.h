/* What an FMU answers to the iteration of events (`discrete.c`). */

#ifndef LMOC_DISCRETE_H
#define LMOC_DISCRETE_H

#include "fmu.h"

double fmu_value(const fmu *f, int64_t zero);           /* as last looked at */
int fmu_unsettled(fmu *f);
int fmu_move(lmoc_instant *e, const double *x, int64_t reinit, double wanted, double *moved);
void fmu_ask(fmu *f);

/* Which functions leave zero at once behind a jump of states (`hops.c`); `at` (zeros,): where they were before it. */
int fmu_turned_back(fmu *f, const double *which, const double *at, double *turn, int *some);
int fmu_wrong_way(fmu *f, const double *which);         /* one that has just left zero seems to be back, and moves away */

#endif
