"""Which campaign to run: equipment, schedules, proposals and their files; knows no instrument."""
