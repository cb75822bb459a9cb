//! A file as an answer, or its rest (RFC 9110, section 14) after a broken connection.

use crate::file_parts::{file_parts, ReadingPace};
use crate::publish::http::{answer, text, HttpLimits, IMMUTABLE};
use axum::body::Body;
use axum::http::header::{ACCEPT_RANGES, CONTENT_LENGTH, CONTENT_RANGE, IF_RANGE, RANGE};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use std::io::{self, SeekFrom};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncSeek, AsyncSeekExt};

/// The first wanted byte of `Range: bytes=N-`. Every other range gets the whole file, as HTTP allows.
pub(super) fn begins(method: &Method, headers: &HeaderMap) -> Option<u64> {
    let mut ranges = headers.get_all(RANGE).iter();
    let range = ranges.next()?.to_str().ok()?;
    if ranges.next().is_some() || *method != Method::GET || headers.contains_key(IF_RANGE) {
        return None;
    }
    let first = range.trim().strip_prefix("bytes=")?.strip_suffix('-')?;
    let number = !first.is_empty() && first.bytes().all(|byte| byte.is_ascii_digit());
    // Too large a number is beyond every file's end.
    number.then(|| first.parse().unwrap_or(u64::MAX))
}

/// About a file of `length` bytes, without the file.
pub(super) fn file_head(length: u64, kind: &'static str) -> Response {
    let about = [
        (ACCEPT_RANGES, "bytes".to_owned()),
        (CONTENT_LENGTH, length.to_string()),
    ];
    (about, answer(200, kind, IMMUTABLE, Body::empty())).into_response()
}

/// A file of `length` bytes that never changes, or its rest.
pub(super) async fn file_answer(
    mut file: impl AsyncRead + AsyncSeek + Unpin + Send + 'static,
    length: u64,
    begins: Option<u64>,
    kind: &'static str,
    limits: &HttpLimits,
) -> io::Result<Response> {
    let first = begins.unwrap_or(0);
    if begins.is_some_and(|first| first >= length) {
        let why = format!("the file has {length} bytes, and no byte {first}\n");
        let range = [(CONTENT_RANGE, format!("bytes */{length}"))];
        return Ok((range, text(416, why)).into_response());
    }
    file.seek(SeekFrom::Start(first)).await?;
    let left = length - first;
    let pace = ReadingPace::of_bytes(left, limits.silence, limits.answer);
    // Each connection has one request, which bounds the open files.
    let parts = Body::from_stream(file_parts(file.take(left), pace, ()));
    let about = [
        (ACCEPT_RANGES, "bytes".to_owned()),
        (CONTENT_LENGTH, left.to_string()),
    ];
    let mut response = (about, answer(200, kind, IMMUTABLE, parts)).into_response();
    if begins.is_some() {
        *response.status_mut() = StatusCode::PARTIAL_CONTENT;
        let range = format!("bytes {first}-{}/{length}", length - 1);
        response = ([(CONTENT_RANGE, range)], response).into_response();
    }
    Ok(response)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    #[test]
    fn only_the_rest_of_a_file_can_be_asked_for() {
        let asked = |range: &'static str| {
            let headers = [(RANGE, HeaderValue::from_static(range))];
            begins(&Method::GET, &headers.into_iter().collect())
        };
        assert_eq!(asked("bytes=0-"), Some(0));
        assert_eq!(asked("bytes=17-"), Some(17));
        assert_eq!(asked("bytes=99999999999999999999-"), Some(u64::MAX));
        for other in ["bytes=-5", "bytes=1-5", "bytes=-", "bytes=+1-", "lines=1-"] {
            assert_eq!(asked(other), None, "{other}");
        }
        let mut headers = HeaderMap::new();
        headers.append(RANGE, HeaderValue::from_static("bytes=1-"));
        assert_eq!(begins(&Method::HEAD, &headers), None);
        // Versions of a file have no names here.
        let mut if_same = headers.clone();
        if_same.insert(IF_RANGE, HeaderValue::from_static("x"));
        assert_eq!(begins(&Method::GET, &if_same), None);
        headers.append(RANGE, HeaderValue::from_static("bytes=2-"));
        assert_eq!(begins(&Method::GET, &headers), None);
    }
}
