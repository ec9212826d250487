"""The records of a robot: plants, muzzle, sensing and limits, one JSON file each."""
