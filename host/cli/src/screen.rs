//! Text that fits on one screen.

/// Lines and columns of a screen: the lines of a usual terminal, and the columns of all other text.
pub const LINES: usize = 24;
pub const COLUMNS: usize = 100;

/// Text wrapped into lines of a screen, with a hanging indent of two columns.
pub fn wrapped(text: &str) -> Vec<String> {
    let mut lines = Vec::new();
    for paragraph in text.lines() {
        let indent = paragraph.len() - paragraph.trim_start().len();
        let mut line = " ".repeat(indent);
        let mut empty = true;
        for word in paragraph.split_whitespace() {
            if !empty && line.chars().count() + 1 + word.chars().count() > COLUMNS {
                lines.push(std::mem::replace(&mut line, " ".repeat(indent + 2)));
                empty = true;
            }
            if !empty {
                line.push(' ');
            }
            line.push_str(word);
            empty = false;
        }
        lines.push(line);
    }
    lines
}

/// The step with which to list `count` lines in what `taken` lines leave of a screen; at least
/// three are listed. The line that states the omission is included.
pub fn one_in(count: usize, taken: usize) -> usize {
    let room = LINES.saturating_sub(taken).max(4);
    if count <= room { 1 } else { count.div_ceil(room - 1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_breaks_between_words_and_keeps_them_all() {
        let text = "note: ".to_owned() + &"seventeen letters, ".repeat(20);
        let lines = wrapped(&text);
        assert!(lines.iter().all(|line| line.chars().count() <= COLUMNS), "{lines:?}");
        assert!(lines[1..].iter().all(|line| line.starts_with("  s") || line.starts_with("  l")));
        let words: Vec<&str> = lines.iter().flat_map(|line| line.split_whitespace()).collect();
        assert_eq!(words, text.split_whitespace().collect::<Vec<_>>());
        assert_eq!(wrapped("  a\nb"), ["  a", "b"]);
    }

    #[test]
    fn tables_leave_out_lines_evenly_until_they_fit() {
        assert_eq!(one_in(20, 4), 1);
        for (count, taken) in [(31, 4), (211, 10), (61, 0), (5, 30)] {
            let step = one_in(count, taken);
            let shown = count.div_ceil(step) + usize::from(step > 1);
            assert!(shown <= LINES.saturating_sub(taken).max(4), "{count} {taken}: {shown}");
        }
    }
}
