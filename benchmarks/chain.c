/* The chain by hand with CVODE (BDF, band): N masses, states interleaved q1 v1 q2 v2 ...
   Built by `chain_peers.sundials_c` where the headers of SUNDIALS 6 or newer are installed. */
#include <cvode/cvode.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <sunlinsol/sunlinsol_band.h>
#include <sunmatrix/sunmatrix_band.h>
#include <time.h>

static int n;
static const double mass = 1.0, stiffness = 100.0, damping = 0.1, amplitude = 0.01, stop = 10.0;

static int rhs(double t, N_Vector y, N_Vector ydot, void *data) {
  const double *x = N_VGetArrayPointer(y);
  double *f = N_VGetArrayPointer(ydot);
  double left = stiffness*x[0] + damping*x[1];
  for (int i = 0; i < n; i++) {
    const double q = i + 1 < n ? x[2*i + 2] : 0, v = i + 1 < n ? x[2*i + 3] : 0;
    const double right = stiffness*(q - x[2*i]) + damping*(v - x[2*i + 1]);
    f[2*i] = x[2*i + 1];
    f[2*i + 1] = (right - left)/mass;
    left = right;
  }
  return 0;
}

static int jacobian(double t, N_Vector y, N_Vector fy, SUNMatrix J, void *data, N_Vector a, N_Vector b, N_Vector c) {
  for (int i = 0; i < n; i++) {
    SM_ELEMENT_B(J, 2*i, 2*i + 1) = 1;
    SM_ELEMENT_B(J, 2*i + 1, 2*i) = -2*stiffness/mass;
    SM_ELEMENT_B(J, 2*i + 1, 2*i + 1) = -2*damping/mass;
    for (int side = -1; side <= 1; side += 2) {
      const int j = i + side;
      if (j < 0 || j >= n) continue;
      SM_ELEMENT_B(J, 2*i + 1, 2*j) = stiffness/mass;
      SM_ELEMENT_B(J, 2*i + 1, 2*j + 1) = damping/mass;
    }
  }
  return 0;
}

int main(int argc, char **argv) {
  n = atoi(argv[1]);
  const int mode = atoi(argv[2]), points = atoi(argv[3]);
  const double rtol = atof(argv[4]), atol = atof(argv[5]), pi = 3.141592653589793;
  SUNContext context;
  SUNContext_Create(0, &context);
  N_Vector y = N_VNew_Serial(2*n, context);
  double *x = N_VGetArrayPointer(y), *result = malloc(sizeof(double)*(size_t)points);
  for (int i = 0; i < n; i++) { x[2*i] = amplitude*sin(mode*pi*(i + 1)/(n + 1)); x[2*i + 1] = 0; }
  struct timespec begin, end;
  clock_gettime(CLOCK_MONOTONIC, &begin);
  void *memory = CVodeCreate(CV_BDF, context);
  CVodeInit(memory, rhs, 0, y);
  CVodeSStolerances(memory, rtol, atol);
  SUNMatrix J = SUNBandMatrix(2*n, 3, 3, context);
  CVodeSetLinearSolver(memory, SUNLinSol_Band(y, J, context), J);
  CVodeSetJacFn(memory, jacobian);
  CVodeSetMaxNumSteps(memory, 10000000);
  for (int k = 1; k < points; k++) {
    double t;
    if (CVode(memory, stop*k/(points - 1), y, &t, CV_NORMAL) < 0) return 1;
    result[k] = x[0];
  }
  clock_gettime(CLOCK_MONOTONIC, &end);
  printf("%.9g %.17g\n", (double)(end.tv_sec - begin.tv_sec) + 1e-9*(double)(end.tv_nsec - begin.tv_nsec), result[points - 1]);
  return 0;
}
