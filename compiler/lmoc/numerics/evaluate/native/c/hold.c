/* What looks at steps that are made without Python in between: the closures of loops (`formulations/landing.py`), or the
   choice of coordinates (`coordinates/certificate.py`). */

typedef struct {
  void *own;
  int (*look)(void *own, double time, const double *x, int first); /* 0 where the way to a place is certainly good: from
                                       the one kept where `first`, else from the last look */
  int (*land)(void *own, double time, double *x);  /* move a state onto the closures: 0 where that is a short way; or 0 */
  void (*keep)(void *own);             /* take the last look for the end of a step */
  int64_t pieces;                      /* into which a way may be divided to look at it more closely */
} lmoc_hold;

/* What there is instead of a step: none is short enough; there is no value beyond; it is to be judged in Python. Or it
   is the last one, since the problem is stiff. */
enum { LMOC_SHORT = 1, LMOC_LOST = 2, LMOC_DOUBTFUL = 3, LMOC_STIFF = 4 };
