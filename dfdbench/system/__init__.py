"""Disk, object stores, locks, caches, pools, extras: what a machine is asked for."""
