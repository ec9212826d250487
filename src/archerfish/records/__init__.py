"""What passes between the stages as files: recordings, plants, muzzles, limits, policies.

Every record has a versioned schema, SI units, and its provenance.
"""
