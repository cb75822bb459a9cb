//! Rust source as tokens, without comments and without what stands in quotes.

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Token<'a> {
    /// An identifier, a keyword or a number.
    Word(&'a str),
    /// `::`
    Colons,
    /// Any other character; a literal in quotes is one `"`.
    Sign(char),
}

/// The tokens of a file.
pub fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut rest = text;
    let mut tokens = Vec::new();
    while let Some(first) = rest.chars().next() {
        let length = if first.is_whitespace() {
            first.len_utf8()
        } else if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            comment_length(rest)
        } else if let Some(length) = quoted_length(rest) {
            tokens.push(Token::Sign('"'));
            length
        } else if is_word(first) {
            let length = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
            tokens.push(Token::Word(&rest[..length]));
            length
        } else if rest.starts_with("::") {
            tokens.push(Token::Colons);
            2
        } else {
            tokens.push(Token::Sign(first));
            first.len_utf8()
        };
        rest = &rest[length..];
    }
    tokens
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The length of a block comment, which may hold others.
fn comment_length(text: &str) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at < text.len() {
        let here = &text.as_bytes()[at..];
        if here.starts_with(b"/*") {
            depth += 1;
            at += 2;
        } else if here.starts_with(b"*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += 1;
        }
    }
    text.len()
}

/// Returns the length of a quoted literal, if one begins here. A lifetime is not a literal.
fn quoted_length(text: &str) -> Option<usize> {
    let prefix = ["br", "cr", "b", "c", "r", ""].into_iter().find(|prefix| {
        text.strip_prefix(prefix)
            .is_some_and(|rest| rest.starts_with(['"', '\'', '#']))
    })?;
    let opened = &text[prefix.len()..];
    if prefix.ends_with('r') {
        let hashes = opened.len() - opened.trim_start_matches('#').len();
        let inside = opened[hashes..].strip_prefix('"')?;
        let close = format!("\"{}", "#".repeat(hashes));
        let end = inside
            .find(&close)
            .map_or(inside.len(), |at| at + close.len());
        return Some(prefix.len() + hashes + 1 + end);
    }
    let quote = opened.chars().next().filter(|c| *c != '#')?;
    let inside = &opened[1..];
    if quote == '\'' && !inside.starts_with('\\') {
        let one = inside.chars().next()?.len_utf8();
        let closed = inside[one..].starts_with('\'');
        return closed.then_some(prefix.len() + 1 + one + 1);
    }
    let mut escaped = false;
    for (at, c) in inside.char_indices() {
        if c == quote && !escaped {
            return Some(prefix.len() + 1 + at + 1);
        }
        escaped = c == '\\' && !escaped;
    }
    Some(text.len())
}

#[test]
fn comments_and_quotes_are_left_out() {
    use Token::*;
    let text = r##"a::b // c::d
        /* e /* f */ g */ 'h "\"i::j" r#"k "l"# 'm' '\'' b'n' br"o\" r p2;"##;
    let expected = [
        Word("a"),
        Colons,
        Word("b"),
        Sign('\''),
        Word("h"),
        Sign('"'),
        Sign('"'),
        Sign('"'),
        Sign('"'),
        Sign('"'),
        Sign('"'),
        Word("r"),
        Word("p2"),
        Sign(';'),
    ];
    assert_eq!(tokens(text), expected);
}
