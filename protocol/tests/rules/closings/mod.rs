//! What a round closes with: its result, shares, and the moments of FedAdam.

mod moments;
mod results;
mod shares;
