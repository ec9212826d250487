"""Identification: from logs to the records of a robot."""
