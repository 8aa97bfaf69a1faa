"""Campaigns: thousands of runs of a declared study, on all cores or on a cluster, and figures with intervals."""
