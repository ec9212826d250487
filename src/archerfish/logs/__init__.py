"""Logs of a gimbal: files of several formats → recordings at equal intervals, with findings on what was repaired."""
