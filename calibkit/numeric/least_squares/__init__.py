"""Linear and nonlinear least squares."""
