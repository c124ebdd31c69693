"""Access to the machine: disk, object stores, locks, caches, pools, installed extras."""
