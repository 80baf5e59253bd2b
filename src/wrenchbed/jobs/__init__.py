"""Long work: worker processes, and finished parts on disk so that a stopped run goes on."""
