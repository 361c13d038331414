"""What can be seen of a trapped object: touch floor, bound, probability of detection."""
