"""Simulated campaigns of gyros on a rate table, by name."""

from calibkit.instruments.gyro_scale import simulate_pair, simulate_rate_table, simulate_triad

CAMPAIGNS = {
    "gyro_pair": simulate_pair.campaign,
    "gyro_triad": simulate_triad.campaign,
    "rate_table": simulate_rate_table.campaign,
}
