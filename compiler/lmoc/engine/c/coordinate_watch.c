/* The watch over the choice of coordinates: at the end of every step, by the condition of what it divides by, by whether
   the constraints keep their rank on the way, and by whether velocities explain it.

   Singular values change by no more than the matrix does (Weyl; Golub and Van Loan, Matrix Computations, 8.6), so that none
   vanishes on a straight way shorter than their sum at its ends. */

#include "coordinates.h"
#include "dense.h"

enum { TIME, SIGN, LEAST, MARGIN };            /* numbers of a place */
enum { FIRST_BETWEEN = 2, HALVINGS = 4, PARTS = 8 }; /* places 0 and 1 are ends of steps; for a look at what is within */
enum { STALLED = 40, QUARTERS = 4 };           /* attempts to come on from one place, each in steps so much shorter */
static const double SHORTEST = 1e-10;          /* of the run: a step as short is no way past a place */

/* ------------------------------------------------------------------ places */

static int64_t table_size(const lmoc_coordinates *c) { return c->watched*(c->columns - c->rows); }
static int64_t width(const lmoc_coordinates *c) {
  return LMOC_PLACE_HEAD + c->count + table_size(c) + c->told + c->solved + c->n;
}
static double *place(const lmoc_coordinates *c, int64_t k) { return c->places + k*width(c); }
static double *matrix(const lmoc_coordinates *c, int64_t k) { return place(c, k) + LMOC_PLACE_HEAD; }
static double *table(const lmoc_coordinates *c, int64_t k) { return matrix(c, k) + c->count; }
static double *coordinates(const lmoc_coordinates *c, int64_t k) { return table(c, k) + table_size(c); }
static double *solutions(const lmoc_coordinates *c, int64_t k) { return coordinates(c, k) + c->told; }
static double *states(const lmoc_coordinates *c, int64_t k) { return solutions(c, k) + c->solved; }

int64_t lmoc_coordinates_lay_out(lmoc_coordinates *c, double *at) {
  const int64_t all = c->rows*c->columns, most = c->blocks ? 0 : 2*all + c->columns;
  int64_t total = 0;
#define TAKE(name, count) (c->name = at ? at + total : 0, total += (count))
  TAKE(places, LMOC_PLACES*width(c)), TAKE(size, c->count), TAKE(bound, c->count), TAKE(row_factor, c->rows);
  TAKE(column_factor, c->columns), TAKE(range, c->columns), TAKE(recent, c->count);
  TAKE(apart, 3*c->watched), TAKE(pace, c->watched), TAKE(work, most + 4*(c->rows + c->columns) + c->count + table_size(c) + c->watched);
#undef TAKE
  c->place = at ? (int32_t *)(at + total) : 0;
  if (at && !c->blocks) for (int64_t k = 0; k < c->count; k++) c->place[k] = (int32_t)k;
  c->recent_least = NAN;
  return total + c->count/2 + 1;
}

static void ask(lmoc_coordinates *c, int what, double time, const double *x, int64_t k, int64_t other) {
  c->answer = NAN;
  if (!c->halted && c->ask(c->owner, what, time, x, k, other)) c->halted = 1;
}

/* An entry with rows and columns in one length. */
static double even(const lmoc_coordinates *c, const double *m, int64_t k) {
  return m[k] * (c->row_factor[k/c->columns] * c->column_factor[k % c->columns]);
}

/* The smallest singular value of the rows of a matrix (rows, columns) that is given transposed, or the largest one; 0
   where it is no matrix of numbers. */
static double singular_value(const lmoc_coordinates *c, int64_t columns, double *transposed, int largest) {
  double *values = transposed + columns*c->rows, found = largest ? 0 : INFINITY, check = 0;
  for (int64_t k = 0; k < columns*c->rows; k++) check += 0*transposed[k];
  if (check != 0) return 0;
  lmoc_singular_values(columns, c->rows, transposed, 0, values);
  for (int64_t i = 0; i < c->rows; i++) found = largest ? fmax(found, values[i]) : fmin(found, values[i]);
  return found;
}

double lmoc_coordinates_margin(lmoc_coordinates *c, int64_t k) {
  double *margin = place(c, k) + MARGIN;
  if (*margin == *margin || c->blocks) return *margin; /* blocks have told it, unless that was interrupted */
  for (int64_t i = 0; i < c->count; i++) c->work[i % c->columns * c->rows + i/c->columns] = even(c, matrix(c, k), i);
  return *margin = singular_value(c, c->columns, c->work, 0);
}

int lmoc_coordinates_vanish(lmoc_coordinates *c, int64_t k) {
  if (c->blocks) {
    ask(c, LMOC_VANISHES, 0, 0, k, k);
    return c->answer != 0;
  }
  double *own = c->work, *dependent = own + c->count;
  memcpy(own, matrix(c, k), c->count * sizeof(double));
  lmoc_rows_of_one_size(c->rows, c->columns, c->count, c->place, c->units, own, dependent);
  for (int64_t i = 0; i < c->rows; i++)
    for (int64_t j = 0; j < c->rows; j++) dependent[j*c->rows + i] = own[i*c->columns + j];
  return singular_value(c, c->rows, dependent, 0) < c->by.vanishing; /* 0 where it is no matrix of numbers */
}

/* Compare entries in the sizes to which they have grown. Singular values shrink by no more than the factors of a row and of
   a column together. */
static void rescale(lmoc_coordinates *c) {
  const int64_t rows = c->rows, columns = c->columns;
  double *before_row = c->work, *before_column = before_row + rows, row = INFINITY, column = INFINITY;
  memcpy(before_row, c->row_factor, rows * sizeof(double));
  memcpy(before_column, c->column_factor, columns * sizeof(double));
  lmoc_equilibrate(&c->by, rows, columns, c->count, c->place, c->size, c->units, (int)c->equilibrated,
                   c->row_factor, c->column_factor, c->range, before_column + columns);
  for (int64_t i = 0; i < rows; i++) row = fmin(row, c->row_factor[i]/before_row[i]);
  for (int64_t j = 0; j < columns; j++) column = fmin(column, c->column_factor[j]/before_column[j]);
  memset(c->work, 0, rows * sizeof(double));
  for (int64_t k = 0; k < c->count; k++) c->work[k/columns] = fmax(c->work[k/columns], c->size[k]);
  for (int64_t k = 0; k < c->count; k++)
    c->bound[k] = c->by.grown*fmax(c->size[k], c->by.no_entry*c->work[k/columns]); /* what rounding leaves is no entry */
  for (int64_t k = 0; k < LMOC_PLACES; k++) {
    place(c, k)[LEAST] *= fmin(1, row*column);
    place(c, k)[MARGIN] = NAN;
  }
  c->recent_least = NAN;
  c->equilibrated = 1;
}

/* What the smallest singular value is not below: from the last one computed as long as that tells enough. */
static double least(lmoc_coordinates *c, int64_t k) {
  double change = 0;
  for (int64_t i = 0; i < c->count; i++) {
    const double d = even(c, matrix(c, k), i) - c->recent[i];
    change += d*d;
  }
  const double bound = c->recent_least - sqrt(change);
  if (bound > c->by.sure) return bound;
  c->recent_least = lmoc_coordinates_margin(c, k);
  for (int64_t i = 0; i < c->count; i++) c->recent[i] = even(c, matrix(c, k), i);
  return c->recent_least;
}

/* The tableau A^-1 B of a place; returns the sign of the determinant of A, 0 where there is none. */
static double eliminate(const lmoc_coordinates *c, int64_t k) {
  const int64_t rows = c->rows, free = c->columns - rows;
  double *a = c->work, *b = a + rows*rows, determinant, sign = 1;
  int32_t *pivots = (int32_t *)(b + rows*free);
  for (int64_t i = 0; i < rows; i++) {
    memcpy(a + i*rows, matrix(c, k) + i*c->columns, rows * sizeof(double));
    memcpy(b + i*free, matrix(c, k) + i*c->columns + rows, free * sizeof(double));
  }
  if (!lmoc_dense_factor(rows, a, pivots, &determinant)) sign = 0;
  lmoc_dense_substitute(rows, a, pivots, free, b);
  for (int64_t i = 0; i < rows; i++) sign *= (pivots[i] == i ? 1 : -1) * lmoc_sign(a[i*rows + i]);
  for (int64_t i = 0; i < c->watched*free; i++)
    table(c, k)[i] = sign == 1 || sign == -1 ? b[c->row[i/free]*free + i % free] : INFINITY;
  return sign == 1 || sign == -1 ? sign : 0;
}

static void look(lmoc_coordinates *c, int64_t k, double time, const double *x) {
  double *own = place(c, k), *m = matrix(c, k);
  int grown = !c->equilibrated;
  memmove(states(c, k), x, c->n * sizeof(double));
  own[TIME] = time;
  own[MARGIN] = NAN;
  own[LEAST] = own[SIGN] = 0;
  ask(c, LMOC_VALUES, time, states(c, k), k, k);
  if (c->blocks || c->halted) return;
  for (int64_t i = 0; i < c->count; i++) {
    c->size[i] = fmax(c->size[i], fabs(m[i]));
    grown |= fabs(m[i]) > c->bound[i];
  }
  if (grown) rescale(c);
  own[SIGN] = eliminate(c, k);
  if (c->ranked) own[LEAST] = least(c, k);
}

/* ------------------------------------------------------------------ judging */

/* The largest entry of the tableau. */
static double worst_entry(const lmoc_coordinates *c, int64_t k) {
  const int64_t free = c->columns - c->rows;
  double worst = 0;
  for (int64_t r = 0; r < c->watched; r++)
    for (int64_t j = 0; j < free && !c->barred[r]; j++)
      worst = lmoc_max(worst, fabs(table(c, k)[r*free + j] * c->range[c->row[r]] / c->range[c->rows + j]));
  return place(c, k)[SIGN] != 0 && worst*0 == 0 ? worst : INFINITY;
}

int lmoc_coordinates_passed(const lmoc_coordinates *c) {
  const double now = place(c, c->last)[SIGN];
  return now == 0 || now != place(c, c->accepted)[SIGN];
}

/* How far a watched coordinate has come between two places, apart from what velocities tell: those by the states, or, where
   no state moves it, that of the step before. */
static double unexplained(const lmoc_coordinates *c, int64_t a, int64_t b, int64_t r) {
  const int64_t free = c->columns - c->rows;
  const double *before = coordinates(c, a), *after = coordinates(c, b);
  double rest = after[c->row[r]] - before[c->row[r]];
  if (!free && c->paced) rest -= c->pace[r]*(place(c, b)[TIME] - place(c, a)[TIME]);
  for (int64_t j = 0; j < free; j++)
    rest += (table(c, a)[r*free + j] + table(c, b)[r*free + j])/2*(after[c->rows + j] - before[c->rows + j]);
  return rest == rest ? fabs(rest) : 0;
}

/* What counts as a radian of a coordinate. Equilibration leaves open in what unit all of them are: in small mechanisms those
   of angles are far from 1. */
static double radian(const lmoc_coordinates *c, int64_t column) {
  double sum = 0;
  int64_t angles = 0, all = 1;
  for (int64_t j = 0; j < c->columns; j++) {
    const int angle = c->units[j] == 1;
    sum += angle ? c->column_factor[j] : 0;
    angles += angle;
    all &= angle;
  }
  return c->column_factor[column]*(all ? 1 : angles ? angles/sum : c->units[column]);
}

/* How far an angle may go unexplained, however far it goes in all. */
static double farthest(const lmoc_coordinates *c, int64_t column) {
  return c->units[column] == 1 ? c->by.turned*radian(c, column) : INFINITY;
}

/* Whether what is unexplained of the way of a watched coordinate may be the distance of two solutions. */
static int is_far(const lmoc_coordinates *c, int64_t r, double rest) {
  return rest >= c->by.neighbours*radian(c, c->row[r]);
}

/* The watched coordinate that velocities explain least, if it is to be looked at what happens within the step; else -1. */
static int64_t unexplained_one(const lmoc_coordinates *c) {
  double most = -INFINITY, way = 0, rest = 0;
  int64_t found = -1;
  for (int64_t r = 0; c->told && r < c->watched; r++) {
    const double own = fabs(coordinates(c, c->last)[c->row[r]] - coordinates(c, c->accepted)[c->row[r]]),
                 allowed = fmin(c->by.unexplained*own, farthest(c, c->row[r])),
                 left = unexplained(c, c->accepted, c->last, r);
    if (!(left - allowed > most)) continue;
    most = left - allowed;
    found = r, way = allowed, rest = left;
  }
  if (found >= 0 && c->columns == c->rows && !c->paced) return found;
  if (found < 0 || !(rest > way)) return -1;
  return rest > way + c->by.rounding*radian(c, c->row[found]) && is_far(c, found, rest) ? found : -1;
}

/* Look at a share of the straight way between two places. */
static void look_between(lmoc_coordinates *c, int64_t a, int64_t b, double share, int64_t k) {
  double *x = states(c, k);
  c->inside = 1;
  for (int64_t i = 0; i < c->n; i++) x[i] = (1 - share)*states(c, a)[i] + share*states(c, b)[i];
  look(c, k, (1 - share)*place(c, a)[TIME] + share*place(c, b)[TIME], x);
}

/* Whether the dependent coordinates have come by their velocities to where they are. Constraints are the same after a whole
   turn of an angle, so that they do not tell if Newton's method has gone over to another solution. What is unexplained by
   velocities becomes less in parts of a step, a jump does not. All parts are looked at: where nothing is explained (a loop
   that its crank moves, and that moves nothing), the one with the longest way need not be the one with the jump. */
static int keeps_on(lmoc_coordinates *c) {
  const int64_t a = c->accepted, b = c->last;
  double *most = c->apart, *left = c->apart + c->watched, *when = left + c->watched;
  if (unexplained_one(c) < 0) return 1;
  for (int64_t r = 0; r < c->watched; r++) most[r] = unexplained(c, a, b, r), left[r] = 0;
  for (int64_t part = 1, before = a; part <= PARTS; part++) {
    const int64_t now = part == PARTS ? b : FIRST_BETWEEN + part % 2;
    if (now != b) look_between(c, a, b, (double)part/PARTS, now);
    for (int64_t r = 0; r < c->watched; r++) {
      const double own = unexplained(c, before, now, r);
      if (own > left[r]) left[r] = own, when[r] = (place(c, before)[TIME] + place(c, now)[TIME])/2;
      most[r] = fmax(most[r], unexplained(c, a, now, r)); /* what turns round has hardly come on in all */
    }
    before = now;
  }
  for (int64_t r = 0; r < c->watched; r++) {
    const double unit = radian(c, c->row[r]), allowed = fmin(c->by.at_once*most[r], farthest(c, c->row[r]));
    if (!is_far(c, r, left[r]) || left[r] <= allowed + c->by.rounding*unit) continue;
    c->singular = when[r];
    return 0;
  }
  return 1;
}

static int is_regular_between(lmoc_coordinates *c, int64_t a, int64_t b) {
  if (c->blocks) {
    ask(c, LMOC_REGULAR, 0, 0, a, b);
    return c->answer == 1;
  }
  double length = 0;
  for (int64_t i = 0; i < c->count; i++) {
    const double d = even(c, matrix(c, b), i) - even(c, matrix(c, a), i);
    length += d*d;
  }
  length = sqrt(length);
  if (length <= c->by.share*(place(c, a)[LEAST] + place(c, b)[LEAST])) return 1;
  const double allowed = c->by.share*(lmoc_coordinates_margin(c, a) + lmoc_coordinates_margin(c, b));
  if (length <= allowed) return 1;
  for (int64_t i = 0; i < c->count; i++)
    c->work[i % c->columns * c->rows + i/c->columns] = even(c, matrix(c, b), i) - even(c, matrix(c, a), i);
  return length*0 == 0 && singular_value(c, c->columns, c->work, 1) <= allowed;
}

/* Whether the constraints keep their rank between two places, judged in between if necessary. */
static int stays_regular(lmoc_coordinates *c, int64_t a, int64_t b, int halvings) {
  if (is_regular_between(c, a, b)) return 1;
  if (!halvings || c->halted) {
    const double before = lmoc_coordinates_margin(c, a), both = before + lmoc_coordinates_margin(c, b);
    c->singular = place(c, a)[TIME] + (place(c, b)[TIME] - place(c, a)[TIME])*(both != 0 ? before/both : 0.5);
    return 0;
  }
  const int64_t middle = FIRST_BETWEEN + HALVINGS - halvings;
  look_between(c, a, b, 0.5, middle);
  return stays_regular(c, a, middle, halvings - 1) && stays_regular(c, middle, b, halvings - 1);
}

/* Whether the constraints are about to depend on each other, and when. */
static int comes_near(lmoc_coordinates *c) {
  if (place(c, c->last)[LEAST] >= c->alert) return 0;
  const double before = lmoc_coordinates_margin(c, c->accepted), now = lmoc_coordinates_margin(c, c->last),
               time = place(c, c->last)[TIME];
  if (!(now < fmin(c->alert, before))) return 0;
  c->singular = time + now/(before - now)*(time - place(c, c->accepted)[TIME]);
  return 1;
}

/* Whether the step looked at is good in all that is judged, without a look at what is within. */
static int is_certain(lmoc_coordinates *c) {
  if (worst_entry(c, c->last) > c->limit || lmoc_coordinates_passed(c) || unexplained_one(c) >= 0) return 0;
  return !c->ranked || (place(c, c->last)[LEAST] > c->by.sure && is_regular_between(c, c->accepted, c->last));
}

static void look_at_end(lmoc_coordinates *c, double time, const double *x) {
  c->last = 1 - c->accepted;
  c->lost_rank = 0;
  look(c, c->last, time, x);
}

int lmoc_coordinates_begin(lmoc_coordinates *c, double time, const double *x) {
  c->accepted = c->last = c->paced = 0;
  look(c, 0, time, x);
  const double worst = worst_entry(c, 0);
  c->limit = fmax(c->limit, c->by.margin*fmin(fmax(1, worst), c->by.tolerated));
  const int bad = worst > c->limit || lmoc_coordinates_vanish(c, 0);
  return c->halted || bad ? LMOC_WORSE : LMOC_SERVE;
}

/* The step looked at is good. */
static void accept(lmoc_coordinates *c) {
  const double length = place(c, c->last)[TIME] - place(c, c->accepted)[TIME];
  for (int64_t r = 0; c->told && r < c->watched && length > 0; r++)
    c->pace[r] = (coordinates(c, c->last)[c->row[r]] - coordinates(c, c->accepted)[c->row[r]])/length;
  c->paced = length > 0;
  c->accepted = c->last;
}

int lmoc_coordinates_judge(lmoc_coordinates *c, double time, const double *x) {
  look_at_end(c, time, x);
  if (!is_certain(c)) {
    if (worst_entry(c, c->last) > c->limit || lmoc_coordinates_passed(c)) return LMOC_WORSE;
    c->inside = 0;
    const int regular = !c->ranked || stays_regular(c, c->accepted, c->last, HALVINGS);
    c->lost_rank = !(regular && keeps_on(c)) || (c->ranked && comes_near(c));
    if (c->halted || c->lost_rank) return LMOC_WORSE;
    if (c->inside) look(c, c->last, time, x); /* the system's blocks go on from the end of the step */
  }
  if (c->halted) return LMOC_WORSE;
  accept(c);
  return LMOC_SERVE;
}

void lmoc_coordinates_tolerate(lmoc_coordinates *c) {
  c->limit = c->by.margin*fmax(c->limit, worst_entry(c, c->last));
}

double lmoc_coordinates_shorter(lmoc_coordinates *c, int64_t stalled, double span, double *until) {
  const double time = place(c, c->accepted)[TIME], margin = c->lost_rank ? lmoc_coordinates_margin(c, c->accepted) : INFINITY;
  *until = place(c, c->last)[TIME];
  if (c->lost_rank) {
    *until = fmax(*until, c->singular);
    c->alert = fmin(c->alert, margin)/2;
  }
  const double length = (*until - time)/QUARTERS;
  return stalled < STALLED && length > SHORTEST*fmax(fabs(time), span) && !(margin < c->by.dependent) ? length : 0;
}

int lmoc_coordinates_stuck(lmoc_coordinates *c, double below) {
  c->last = c->accepted;
  c->singular = place(c, c->accepted)[TIME];
  return (int)(c->lost_rank = below > 0 && lmoc_coordinates_margin(c, c->accepted) < below);
}

int64_t lmoc_coordinates_lost(const lmoc_coordinates *c) {
  const int64_t free = c->columns - c->rows;
  int64_t lost = 0;
  double most = -1;
  for (int64_t k = 0; k < c->watched*free; k++) {
    const double entry = fabs(table(c, c->last)[k] * c->range[c->row[k/free]] / c->range[c->rows + k % free]),
                 size = entry*0 == 0 ? entry : INFINITY;
    if (size > most) most = size, lost = k/free;
  }
  return lost;
}

/* Those that are good where the step rejected has led to, as long as it has passed no singular place; otherwise those that
   are best where it began. */
int lmoc_coordinates_better(lmoc_coordinates *c, int32_t *held) {
  const int64_t k = lmoc_coordinates_passed(c) || c->lost_rank ? c->accepted : c->last, free = c->columns - c->rows;
  double *own = c->work;
  int32_t *dependent = (int32_t *)(own + table_size(c));
  uint8_t *barred = (uint8_t *)(dependent + c->watched);
  if (place(c, k)[SIGN] == 0) {
    for (int64_t i = 0; i < c->count; i++) own[i] = even(c, matrix(c, k), i);
    return lmoc_states_by_pivots(&c->by, c->rows, c->columns, own, held);
  }
  for (int64_t r = 0; r < c->watched; r++) {
    dependent[r] = c->row[r];
    barred[r] = c->barred[r];
    for (int64_t j = 0; j < free; j++)
      own[r*free + j] = table(c, k)[r*free + j] * c->range[c->row[r]] / c->range[c->rows + j];
  }
  for (int64_t j = 0; j < free; j++) held[j] = (int32_t)(c->rows + j);
  return lmoc_exchanges(c->by.good, c->watched, free, own, barred, dependent, held);
}

/* ------------------------------------------------------------------ without Python */

/* The values of a place at which the registers stand. */
static void values_here(lmoc_step_watch *s, double time, int64_t k) {
  const lmoc_coordinates *c = s->by;
  for (int64_t i = 0; i < c->told; i++) coordinates(c, k)[i] = s->registers[s->told[i]];
  for (int64_t i = 0; i < c->solved; i++) solutions(c, k)[i] = s->registers[s->solved[i]];
  for (int64_t i = 0; i < s->read_count; i++) s->w[s->reads[i]] = s->registers[s->reads[i]];
  s->tape->run(time, s->w, s->tape);
  memset(matrix(c, k), 0, c->count * sizeof(double));
  for (int64_t e = 0; e < s->entry_count; e++) matrix(c, k)[s->target[e]] += s->w[s->entry[e]];
}

int lmoc_step_watch_values(void *own, int what, double time, const double *x, int64_t k, int64_t other) {
  lmoc_step_watch *s = own;
  (void)what, (void)other;
  s->evaluate(s->call, time, x);
  values_here(s, time, k);
  return 0;
}

double lmoc_step_watch_margin(lmoc_step_watch *s, double time) {
  const int64_t k = LMOC_PLACES - 1; /* no step is being looked at */
  values_here(s, time, k);
  place(s->by, k)[MARGIN] = NAN;
  return lmoc_coordinates_margin(s->by, k);
}

double lmoc_coordinates_sign(const lmoc_coordinates *c) { return place(c, c->accepted)[SIGN]; }

const double *lmoc_coordinates_accepted(const lmoc_coordinates *c, double *time, const double **x) {
  *time = place(c, c->accepted)[TIME];
  *x = states(c, c->accepted);
  return solutions(c, c->accepted);
}

int lmoc_step_watch_look(void *own, double time, const double *x, int first) {
  lmoc_step_watch *s = own;
  (void)first;
  if (s->kept == s->room || s->evaluate(s->call, time, x)) return 1;
  look_at_end(s->by, time, x);
  return !is_certain(s->by);
}

void lmoc_step_watch_keep(void *own) {
  lmoc_step_watch *s = own;
  lmoc_coordinates *c = s->by;
  double *record = s->record + s->kept*(1 + c->n + c->solved);
  accept(c);
  s->mark(s->call);
  s->kept++;
  record[0] = place(c, c->last)[TIME];
  memcpy(record + 1, states(c, c->last), c->n * sizeof(double));
  memcpy(record + 1 + c->n, solutions(c, c->last), c->solved * sizeof(double));
}
