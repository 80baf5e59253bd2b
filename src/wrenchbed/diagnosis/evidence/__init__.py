"""What each effect would add to each reading, and the exact evidence of each hypothesis."""
