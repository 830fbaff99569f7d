"""What many voyages say together: trends over dates, flexure against the sea, effects that repeat. Pure functions."""
