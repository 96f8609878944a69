"""Attacks on calibkit: what each tries, and how many it survived."""
