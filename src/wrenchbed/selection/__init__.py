"""Choice of configurations: observability indices, exchange, certified bounds, elimination."""
