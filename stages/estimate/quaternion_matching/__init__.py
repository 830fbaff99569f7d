"""Attitude quaternion matching as published: what TD-MA, the model-free method and its traditional rival share."""
