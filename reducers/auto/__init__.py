"""Choice of a reducer by trial runs over the training run."""
