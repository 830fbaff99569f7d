"""How good an estimate is: its error against every reference the log holds."""

from stages.score.rmse import Scoring, score, score_all

__all__ = ["Scoring", "score", "score_all"]
