"""What the paper prints, what it leaves open, and how we read its damaged and inconsistent parts.

The numbers are in the JSON files beside the modules, each with a flag for how well it can be read; nothing printed is
typed anywhere else. docs/errata.md holds the reasons for our readings.
"""
