"""The blind check: sealed logs of an independent reality, answers without the key, one opening of the seal."""
