"""A recorded flight as Foxglove's well-known messages, and the layout that shows them."""
