"""Scale factors of gyros on a rate table: single gyros, pairs and triads."""
