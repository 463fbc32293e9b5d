/* By hand: accelerations of many double pendulums of uniform bars, and of many masses on two cubic springs in series.
   States as arrays of numbers, one after the other: (angle 1, rate 1, angle 2 against bar 1, its rate); (position, rate). */
#include <math.h>

void pendulums(long n, const double *x, double *f) {
  const double l1 = 1.0, m1 = 1.0, l2 = 0.7, m2 = 0.5, g = 9.81;
  for (long i = 0; i < n; i++, x += 4, f += 4) {
    const double w1 = x[1], w2 = x[1] + x[3], angle = x[0] + x[2];
    const double c = cos(x[2]), s = -sin(x[2]);
    const double a11 = (m1/3 + m2)*l1*l1, a12 = 0.5*m2*l1*l2*c, a22 = m2*l2*l2/3, h = 0.5*m2*l1*l2*s;
    const double b1 = -h*w2*w2 - (0.5*m1 + m2)*l1*g*cos(x[0]), b2 = h*w1*w1 - 0.5*m2*l2*g*cos(angle);
    const double det = a11*a22 - a12*a12;
    f[0] = x[1];
    f[1] = (a22*b1 - a12*b2)/det;
    f[2] = x[3];
    f[3] = (a11*b2 - a12*b1)/det - f[1];
  }
}

/* The massless point between the springs by Newton's method, from where it was last (in `between`). */
void pairs(long n, const double *x, double *f, double *between, const double *k1, const double *k2) {
  for (long i = 0; i < n; i++, x += 2, f += 2) {
    double p = between[i], step = 1;
    for (int k = 0; k < 50 && fabs(step) > 1e-13*(1 + fabs(p)); k++) {
      const double d = x[0] - p;
      step = (k1[i]*p*p*p - k2[i]*d*d*d)/(3*k1[i]*p*p + 3*k2[i]*d*d);
      p -= step;
    }
    between[i] = p;
    f[0] = x[1];
    f[1] = -k1[i]*p*p*p;
  }
}
