"""Field stacks, acquisition records, recorded points and the tables that results are written to."""
