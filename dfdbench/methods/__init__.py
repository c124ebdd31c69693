"""Find a method by name, and call it so that one bad pair cannot spoil a run."""
