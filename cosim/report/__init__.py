"""What people look at: a page that shows runs, made from their results alone."""
