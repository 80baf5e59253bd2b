"""Choice of what to record: pose criteria, exchange, certificates, accuracy plans, clearance."""
