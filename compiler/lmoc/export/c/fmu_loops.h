/* Closed loops whose coordinates are all states of an FMU (`fmu_loops.c`). */

#ifndef LMOC_FMU_LOOPS_H
#define LMOC_FMU_LOOPS_H

#include "fmu.h"

int fmu_loops_new(fmu *f);                              /* 0 where there is no memory */
void fmu_loops_free(fmu *f);
int64_t fmu_loops_place(fmu *f, double *at);            /* memory that a saved state has to hold … */
int64_t fmu_loops_scratch(fmu *f, double *at);          /* … and such that it has not; how much */
void fmu_loops_parameters(fmu *f);                      /* what closures read of parameters */

/* Close the loops where the scene starts, with the parameters and states that have been set. */
int fmu_loops_begin(fmu *f);

/* Co-Simulation: what looks at steps (`lmoc_step_hook`). */
int fmu_loops_look(void *own, double time, const double *x);
int fmu_loops_land(void *own, double time, double *x);
void fmu_loops_keep(void *own);

/* Velocities that an event has changed, those of the same loops follow; and steps begin where the states are. */
int fmu_loops_follow(lmoc_instant *e, const double *x, double *moved);
int fmu_loops_stand(fmu *f);

/* Model Exchange: the other side has made a step; and states back onto the closures where they have left them. */
int fmu_loops_accept(fmu *f);
int fmu_loops_return(fmu *f);

int fmu_loops_depend(fmu *f);                           /* says so */

#endif
