/* The engine as an extension module of Python, so that every installer knows how to build and to find it.

   The module itself is empty: `engine/library.py` calls the functions of the shared library by their names. */

#define Py_LIMITED_API 0x030b0000
#include <Python.h>

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_engine", "lmoc's engine", 0, 0, 0, 0, 0, 0};

PyMODINIT_FUNC PyInit__engine(void) { return PyModule_Create(&definition); }
