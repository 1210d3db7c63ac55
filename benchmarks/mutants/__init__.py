"""How many small errors in the solver and in the verification of answers the tests notice."""
