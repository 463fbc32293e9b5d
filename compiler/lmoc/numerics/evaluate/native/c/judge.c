/* Steps judged by their certificate, without Python in between (``lmoc_hold``); those that are certainly good are put on
   record. Where a bound does not hold, `coordinates/watch.py` has to look at the step. */
typedef struct {
  void *call;                             /* the system, with what evaluates it … */
  int (*evaluate)(void *call, double time, const double *x);
  void (*mark)(void *call);               /* … and marks where it has been solved last */
  const double *registers;                /* of the system */
  double *w;                              /* arguments of the certificate */
  const int64_t *m;
  const void *const *tab;
  double *given, *found;
  const int32_t *reads, *told, *solved;   /* registers that it reads; of the coordinates, of the unknowns of blocks */
  int64_t read_count, solved_count, n;
  double limit, sure, share, sign, least; /* what bounds are compared with; `least` is that where the step begins */
  double *rows, *columns;                 /* factors with which rows and columns have one length … */
  const double *counted;                  /* … and 1 for each row of the tableau that counts, else 0 */
  int64_t rescaled;                       /* how often these have been made anew */
  double *places;                         /* (room, 1 + n + solved_count) times, states, solutions */
  int64_t count, room;
} lmoc_judge;

/* Factors of rows and columns for the sizes to which entries have grown: `equilibrated` in `coordinates/tableau.py`, and
   what follows from them in `watch.py`. The smallest singular value shrinks by no more than both together. */
static void lmoc_judge_rescale(lmoc_judge *s) {
  double *factor = s->given + COUNT + WATCHED*STATES + 2*TOLD, *size = factor + COUNT, *bound = size + COUNT,
         *scale = bound + COUNT, *brief = scale + WATCHED*STATES;
  double largest[ROWS] = {0}, square[COUNT], column[COLUMNS], row[ROWS], in_row[ROWS] = {0}, in_column[COLUMNS] = {0};
  double range[COLUMNS] = {0}, least_row = INFINITY, least_column = INFINITY;
  for (int k = 0; k < COUNT; k++) largest[place[k]/COLUMNS] = fmax(largest[place[k]/COLUMNS], size[k]);
  for (int k = 0; k < COUNT; k++) {
    const int i = place[k]/COLUMNS, j = place[k] % COLUMNS;
    square[k] = size[k]*0 == 0 && size[k] > ROUNDING*largest[i] ? size[k]*size[k] : 0;
    in_row[i] += square[k];
    in_column[j] += square[k];
    if (largest[i] > 0) range[j] = fmax(range[j], size[k]/largest[i]);
  }
  for (int j = 0; j < COLUMNS; j++) column[j] = s->columns[j]*s->columns[j];
  for (int n = 0; ; n++) {
    double sum[COLUMNS] = {0}, changed = 0;
    for (int i = 0; i < ROWS; i++) row[i] = in_row[i] == 0;
    for (int k = 0; k < COUNT; k++) row[place[k]/COLUMNS] += square[k]*column[place[k] % COLUMNS];
    for (int i = 0; i < ROWS; i++) row[i] = 1/row[i];
    if (n == AGAIN) break;
    for (int j = 0; j < COLUMNS; j++) sum[j] = in_column[j] == 0;
    for (int k = 0; k < COUNT; k++) sum[place[k] % COLUMNS] += row[place[k]/COLUMNS]*square[k];
    for (int j = 0; j < COLUMNS; j++) {
      changed = fmax(changed, fabs(column[j]*sum[j] - 1));
      column[j] = 1/sum[j];
    }
    if (n % 2 && changed <= NORMAL) n = AGAIN - 1;
  }
  for (int i = 0; i < ROWS; i++) {
    const double now = sqrt(row[i]);
    least_row = fmin(least_row, now/s->rows[i]);
    s->rows[i] = now;
  }
  for (int j = 0; j < COLUMNS; j++) {
    const double now = sqrt(column[j]);
    least_column = fmin(least_column, now/s->columns[j]);
    s->columns[j] = now;
    if (!(range[j] > 0)) range[j] = 1;
  }
  s->least *= fmin(1, least_row*least_column);
  for (int k = 0; k < COUNT; k++) {
    factor[k] = s->rows[place[k]/COLUMNS]*s->columns[place[k] % COLUMNS];
    bound[k] = GROWN*size[k];
  }
  for (int r = 0; r < WATCHED; r++) {
    brief[r] = NEIGHBOURS*s->columns[watched[r]];
    for (int j = 0; j < STATES; j++) scale[r*STATES + j] = s->counted[r]*range[watched[r]]/range[ROWS + j];
  }
  s->rescaled++;
}

static double *lmoc_judged_place(const lmoc_judge *s) { return s->places + s->count*(1 + s->n + s->solved_count); }

/* 0 where the step to a place is certainly good. Written so that what is no number is not. */
int lmoc_judge_look(void *own, double time, const double *x, int first) {
  lmoc_judge *s = own;
  double *after = s->given + COUNT + WATCHED*STATES + TOLD, *size = after + TOLD + COUNT;
  const double *larger = s->found + COUNT + WATCHED*STATES, *bounds = larger + COUNT;
  (void)first;
  if (s->count == s->room || s->evaluate(s->call, time, x)) return 1;
  for (int k = 0; k < TOLD; k++) after[k] = s->registers[s->told[k]];
  for (int64_t k = 0; k < s->read_count; k++) s->w[s->reads[k]] = s->registers[s->reads[k]];
  lmoc_certificate(time, s->w, s->m, s->tab, s->given, s->found);
  memcpy(size, larger, COUNT * sizeof(double));
  if (bounds[5] > 0) {
    lmoc_judge_rescale(s);
    lmoc_certificate(time, s->w, s->m, s->tab, s->given, s->found);
  }
  if (!(bounds[0] <= s->limit && bounds[1] == s->sign && bounds[2] > s->sure && bounds[4] <= 0 && bounds[5] <= 0
        && bounds[3] <= s->share * (s->least + bounds[2]))) return 1;
  double *place = lmoc_judged_place(s);
  place[0] = time;
  memcpy(place + 1, x, s->n * sizeof(double));
  for (int64_t k = 0; k < s->solved_count; k++) place[1 + s->n + k] = s->registers[s->solved[k]];
  return 0;
}

/* Go on from the end of the step looked at last. */
void lmoc_judge_keep(void *own) {
  lmoc_judge *s = own;
  double *before = s->given + COUNT + WATCHED*STATES;
  memcpy(s->given, s->found, (COUNT + WATCHED*STATES) * sizeof(double));
  for (int k = 0; k < TOLD; k++) before[k] = before[TOLD + k];
  s->least = s->found[2*COUNT + WATCHED*STATES + 2];
  s->mark(s->call);
  s->count++;
}
