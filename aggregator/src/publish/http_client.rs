//! Requests to a witness over HTTP.

/// The answer of a witness.
pub(crate) struct Answer {
    /// HTTP status.
    pub status: u16,
    /// Body.
    pub body: Vec<u8>,
}

/// Sends a body with POST, and reads an answer of at most `limit` bytes.
pub(crate) fn post(
    agent: &ureq::Agent,
    url: &str,
    body: &[u8],
    limit: u64,
) -> Result<Answer, String> {
    let mut response = agent
        .post(url)
        .send(body)
        .map_err(|error| error.to_string())?;
    let status = response.status().as_u16();
    let body = response
        .body_mut()
        .with_config()
        .limit(limit)
        .read_to_vec()
        .map_err(|error| error.to_string())?;
    Ok(Answer { status, body })
}
