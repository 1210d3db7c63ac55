"""The panels of the page: one file each, mounted by `console.page`."""
