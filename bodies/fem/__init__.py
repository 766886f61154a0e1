"""Finite-element matrices of cells of all kinds; common functions for 2-D and 3-D."""
