"""Files that this program wrote: their list, which `--force` and clean-up obey, and temporary
folders."""
