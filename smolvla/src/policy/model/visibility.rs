//! Which token sees which, and positions: LeRobot's `make_att_2d_masks` and position ids, in two phases.
//!
//! Images and language see each other. The state token sees them and itself. An action token sees the prefix and the action tokens up to
//! itself. Invalid tokens (padding, absent cameras) are not seen, and take no position.

/// The number of valid tokens up to a prefix token, minus one.
pub fn prefix_positions(valid: &[bool]) -> Vec<i64> {
    let mut position = -1;
    valid
        .iter()
        .map(|v| {
            position += i64::from(*v);
            position
        })
        .collect()
}

/// Positions of `chunk` action tokens after a prefix.
pub fn action_positions(valid: &[bool], chunk: usize) -> Vec<i64> {
    let start = valid.iter().filter(|v| **v).count() as i64;
    (start..start + chunk as i64).collect()
}

/// Whether prefix token `query` sees `key`; `state` is the state token's index.
pub fn prefix_sees(valid: &[bool], state: usize, query: usize, key: usize) -> bool {
    valid[query] && valid[key] && (key != state || query == state)
}

/// Whether action token `query` sees `key`; keys are the prefix, then the action tokens.
pub fn action_sees(valid: &[bool], query: usize, key: usize) -> bool {
    match key.checked_sub(valid.len()) {
        None => valid[key],
        Some(action) => action <= query,
    }
}
