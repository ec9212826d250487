"""A robot with mechanics, firmware, link, camera, muzzle and referee of its own, in the place of a real one.

Nothing here uses the identified models of `dynamics`, but for the world, which has the records that a robot's computer
would have; nothing that identifies or trains reads a virtual robot's parameters. It is known by messages and logs.
"""
