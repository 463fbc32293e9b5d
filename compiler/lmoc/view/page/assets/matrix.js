// Least squares with small matrices, arrays of rows, that may be singular.

/**
 * Singular values and vectors, {u, values, v} with matrix = u·diag(values)·vᵀ, by rotations of its columns (M. R.
 * Hestenes, Inversion of matrices by biorthogonalization, J. SIAM 6, 1958). Columns of `u` are not normalized:
 * they have the singular values as their lengths.
 */
function singular(matrix) {
  const n = matrix[0].length;
  const u = matrix.map((row) => Float64Array.from(row));
  const v = Array.from({ length: n }, (_, i) => Float64Array.from({ length: n }, (_, j) => Number(i === j)));
  for (let sweep = 0, turning = true; turning && sweep < 60; sweep++) {
    turning = false;
    for (let p = 0; p < n; p++) {
      for (let q = p + 1; q < n; q++) {
        let [a, b, c] = [0, 0, 0];
        for (const row of u) {
          a += row[p] * row[p];
          b += row[q] * row[q];
          c += row[p] * row[q];
        }
        if (Math.abs(c) <= 1e-15 * Math.sqrt(a * b) || c === 0) continue;
        turning = true;
        const zeta = (b - a) / (2 * c);
        const t = (zeta < 0 ? -1 : 1) / (Math.abs(zeta) + Math.hypot(1, zeta));
        const cosine = 1 / Math.hypot(1, t);
        for (const row of [...u, ...v]) {
          const kept = row[p];
          row[p] = cosine * kept - cosine * t * row[q];
          row[q] = cosine * t * kept + cosine * row[q];
        }
      }
    }
  }
  const values = v.map((_, j) => Math.sqrt(u.reduce((sum, row) => sum + row[j] * row[j], 0)));
  return { u, values, v };
}

/** The shortest vector that minimizes |matrix·x − right|; singular values below a share of the largest count as none. */
export function leastSquares(matrix, right, share) {
  const { u, values, v } = singular(matrix);
  const least = share * Math.max(...values);
  const along = values.map((s, j) => (s > least ? u.reduce((sum, row, i) => sum + row[j] * right[i], 0) / (s * s) : 0));
  return v.map((row) => row.reduce((sum, s, j) => sum + s * along[j], 0));
}
