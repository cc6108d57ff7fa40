"""Results as files of other tools; a module of this folder for each format, named in `cosim.export.formats`."""
