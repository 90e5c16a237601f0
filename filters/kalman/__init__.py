"""The filters: one model, equations to be read, the same step compiled, a run of it over samples, and its verdicts."""
