/* Impulses at an instant (`strike.c`), for `transition.c`. */

#ifndef LMOC_STRIKE_H
#define LMOC_STRIKE_H

#include "kinematics.h"

#define LMOC_STILL 1e-11       /* rates below this share of the velocities that make them are zero */

/* An impact of some laws. */
typedef struct {
  int64_t count, *which, law;
  double *impulse, *rate, *lost; /* (count,) */
} lmoc_impact;

int lmoc_is_impulsive(const lmoc_kinematics *k, int64_t law);   /* only complementarities between inertias carry impulses */

int lmoc_is_lossless(const lmoc_kinematics *k, int64_t law);    /* all bounces left are no series that ends */

/* The rates below which motions are at rest: rounding of the velocities, and of the time of the event. */
double lmoc_least_rate(const lmoc_contact *now, int64_t n, int64_t law);
double lmoc_acceleration(const lmoc_contact *now, int64_t n, int64_t law); /* that the states and its own friction make */

/* The effect of such laws on each other, out of that of all n. */
void lmoc_part_of(const lmoc_contact *now, int64_t n, const lmoc_impact *one, double *matrix);

/* Laws that strike, with the friction at their contacts. */
void lmoc_sharing(const lmoc_kinematics *k, const lmoc_flag *striking, lmoc_flag *sharing);

/* `held` (n,) laws take part as they are closed; `laws` those without a solution. */
int lmoc_strike(const lmoc_kinematics *k, const lmoc_contact *now, const lmoc_flag *sharing, const lmoc_flag *held,
                const double *restitution, lmoc_impact *found, lmoc_flag *laws);

/* The instant behind impulses of some laws; states that keep accounts do not take part. */
int lmoc_behind(const lmoc_kinematics *k, const lmoc_contact *now, const lmoc_impact *impact, lmoc_contact *to);

/* The impulses that bring laws to rest, as all further impacts together do. */
int lmoc_rest(const lmoc_kinematics *k, const lmoc_contact *now, const lmoc_flag *held, lmoc_impact *found);

/* States behind impulses by which closed laws resist rates that would close them further. */
int lmoc_resisted(const lmoc_kinematics *k, double time, const double *x, const lmoc_flag *closed, double *behind,
                  lmoc_flag *laws);

lmoc_impact *lmoc_impact_new(int64_t laws);
void lmoc_impact_free(lmoc_impact *one);

#endif
