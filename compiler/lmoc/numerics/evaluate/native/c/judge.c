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
  double *places;                         /* (room, 1 + n + solved_count) times, states, solutions */
  int64_t count, room;
} lmoc_judge;

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
