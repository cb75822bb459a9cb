mod evaluation_set;
mod lying_aggregator;
mod stored_update;
