"""From the search back to the prediction: the effects that a search confirmed become part of the campaign's network."""
