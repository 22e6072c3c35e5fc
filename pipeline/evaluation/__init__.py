"""How good a run was, against ground truth where there is one."""
