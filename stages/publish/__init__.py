"""Results on their way out: message channels, tables, recordings, figures in words."""
