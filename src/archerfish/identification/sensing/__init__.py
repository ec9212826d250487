"""Camera and link: timing, noise and delays from recordings."""
