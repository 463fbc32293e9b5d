/* The laws of a scene in an FMU (`fmu_laws.c`). */

#ifndef LMOC_FMU_LAWS_H
#define LMOC_FMU_LAWS_H

#include "fmu.h"

void fmu_law_ask(fmu *f);               /* who is asked, and where the memory stands */
void fmu_law_parameters(fmu *f);        /* quantities that are parameters */
void fmu_law_given(fmu *f);             /* the laws are judged with the present parameters, inputs and discrete values */
void fmu_law_look(fmu *f);              /* before parameters change … */
void fmu_law_compare(fmu *f);           /* … and whether that has moved what is closed */
void fmu_law_mode(fmu *f);              /* the mode into the registers */

int64_t fmu_law_roots(const fmu *f);    /* two a law: the second where it sticks, else 1 */
void fmu_law_indicators(fmu *f, double *out);  /* at a place that has been looked at */
void fmu_law_watch(fmu *f);             /* a segment begins there */

int fmu_law_begin(fmu *f, int for_good);
int fmu_law_strike(fmu *f, const double *before);  /* the states have stepped from there, and what is closed keeps closed */
int fmu_law_happen(fmu *f, const lmoc_flag *which);
int fmu_law_settle(fmu *f, int (*settle)(void *own, double time, double *x)); /* with the discrete equations */

int fmu_law_keep(void *own, double time, double *x);  /* as a step hook moves states onto what is closed */

#endif
