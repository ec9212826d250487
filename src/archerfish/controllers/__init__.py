"""Everything that turns what is seen into an angle command, behind one small protocol."""
