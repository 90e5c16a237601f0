"""What is known of the motion: the table's profile, references for the filter, how both are joined to a log's time."""
