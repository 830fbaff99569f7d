"""The steps of the pipeline: pure functions from data classes to data classes. What several share stands here."""
