"""What data look like: trials, products of the stages, rig, message definitions and the wire.

The ground floor of deckflex. Nothing here imports another package of the project.
"""
