//! The commands of our pages.

/// The commands in the `sh` blocks of a page, each in one line and without its comment.
pub fn commands(page: &str) -> Vec<String> {
    let (mut in_block, mut in_shell) = (false, false);
    let mut command = String::new();
    let mut commands = Vec::new();
    for line in page.lines().map(str::trim) {
        if let Some(language) = line.strip_prefix("```") {
            in_block = !in_block;
            in_shell = in_block && language == "sh";
        } else if in_shell {
            let line = without_comment(line);
            let goes_on = line.strip_suffix('\\');
            command.push_str(goes_on.unwrap_or(line));
            if goes_on.is_none() && !command.is_empty() {
                commands.push(std::mem::take(&mut command));
            }
        }
    }
    commands
}

/// What a page has in backquotes outside its blocks, each in one line.
pub fn mentions(page: &str) -> Vec<String> {
    let mut in_block = false;
    let outside = page.lines().filter(|line| {
        let is_fence = line.trim_start().starts_with("```");
        in_block ^= is_fence;
        !in_block && !is_fence
    });
    let outside: Vec<_> = outside.collect();
    let in_backquotes = outside.join("\n");
    let in_backquotes = in_backquotes.split('`').skip(1).step_by(2);
    in_backquotes
        .map(|text| text.split_whitespace().collect::<Vec<_>>().join(" "))
        .collect()
}

/// A number sign between spaces begins a comment.
fn without_comment(line: &str) -> &str {
    if line.starts_with("# ") {
        return "";
    }
    line.split_once(" # ")
        .map_or(line, |(command, _)| command.trim_end())
}

#[cfg(test)]
mod tests {
    use super::{commands, mentions};

    #[test]
    fn blocks_for_a_shell_hold_commands_and_backquotes_hold_mentions() {
        let page = "Run `zk0\n status`:\n\
            ```sh\n# first\nzk0 node keygen n.key    # prints it\n  zk0 train \\\n      --out run#1\n\n```\n\
            ```text\nnothing `here`\n```\nand `make`.\n";
        assert_eq!(
            commands(page),
            ["zk0 node keygen n.key", "zk0 train --out run#1"]
        );
        assert_eq!(mentions(page), ["zk0 status", "make"]);
    }
}
