"""The tabs of a recording, one module each: what is logged for it and how its views are laid out."""
