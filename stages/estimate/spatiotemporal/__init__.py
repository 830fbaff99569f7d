"""Time and space aligned in turn: the two-step loop of the TD-MA paper."""
