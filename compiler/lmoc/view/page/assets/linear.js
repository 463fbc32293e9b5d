// Dense linear equations by Gauss elimination with row pivoting (Golub and Van Loan, Matrix Computations, 3.4).

/** Factorize the matrix `a` (rows one after the other) in place; the sign of its determinant, 0 where it is singular. */
export function factorize(a, size, pivots) {
  let sign = 1;
  for (let k = 0; k < size; k++) {
    let pivot = k;
    for (let i = k + 1; i < size; i++) if (Math.abs(a[i * size + k]) > Math.abs(a[pivot * size + k])) pivot = i;
    pivots[k] = pivot;
    if (pivot !== k) {
      sign = -sign;
      for (let j = 0; j < size; j++) {
        const kept = a[k * size + j];
        a[k * size + j] = a[pivot * size + j];
        a[pivot * size + j] = kept;
      }
    }
    const own = a[k * size + k];
    if (!Number.isFinite(own) || own === 0) return 0;
    if (own < 0) sign = -sign;
    for (let i = k + 1; i < size; i++) {
      const factor = (a[i * size + k] /= own);
      if (factor !== 0) for (let j = k + 1; j < size; j++) a[i * size + j] -= factor * a[k * size + j];
    }
  }
  return sign;
}

/** Solve with the factors of `factorize`; `b` becomes the solution. */
export function substitute(a, size, pivots, b) {
  for (let k = 0; k < size; k++) {
    const pivot = pivots[k];
    if (pivot !== k) [b[k], b[pivot]] = [b[pivot], b[k]];
  }
  for (let k = 0; k < size; k++) for (let i = k + 1; i < size; i++) b[i] -= a[i * size + k] * b[k];
  for (let k = size - 1; k >= 0; k--) {
    for (let j = k + 1; j < size; j++) b[k] -= a[k * size + j] * b[j];
    b[k] /= a[k * size + k];
  }
}
