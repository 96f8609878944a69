"""What coefficients mean: a run's results at any point, against an earlier run, and over years."""
