mod budget;
mod evaluation_set;
mod lying_aggregator;
mod registering;
mod stored_update;
mod tensorboard;
