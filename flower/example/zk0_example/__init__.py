"""A Flower app whose rounds are on a zk0 ledger."""
