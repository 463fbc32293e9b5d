"""Compiled kernels, and SUNDIALS called without Python between the steps."""
