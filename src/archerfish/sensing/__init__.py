"""What a controller gets to see, how a policy's observation is built from it, how its action becomes an angle."""
