"""Files of others brought here: fetched, resumed, checked, unpacked."""
