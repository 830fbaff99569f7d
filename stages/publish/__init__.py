"""Results on their way out: message channels, tables, recordings, figures in words."""

OWN_TOPICS = "/deckflex/"
"""Where the topics of all channels written back begin."""
