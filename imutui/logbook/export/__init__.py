"""A log's content as CSV, NPZ or Parquet: what columns there are, and how each format holds them."""
