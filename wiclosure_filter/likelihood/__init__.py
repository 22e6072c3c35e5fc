"""How likely measurements are under a frame transform: the mixture, its residuals, and whether a log fits at all."""
