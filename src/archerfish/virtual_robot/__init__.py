"""The robot that stands in for a real one: its own physics, firmware, link, camera, muzzle and referee.

Nothing here uses the identified models of `dynamics`, and nothing that trains or identifies reads a robot's parameters:
it speaks through messages and logs only.
"""
