/* What an FMU answers to the iteration of events (`discrete.c`). */

#ifndef LMOC_DISCRETE_H
#define LMOC_DISCRETE_H

#include "fmu.h"

double fmu_value(const fmu *f, int64_t zero);           /* as last looked at */
int fmu_unsettled(fmu *f);
int fmu_move(lmoc_instant *e, const double *x, int64_t reinit, double wanted, double *moved);
void fmu_ask(fmu *f);
void fmu_ask_events(fmu *f);

#endif
