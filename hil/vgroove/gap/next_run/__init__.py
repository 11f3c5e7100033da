"""Which run to record next: the menu of runs and the design of the experiment."""
