//! Reads from source text which paths it names. No parser: comments, texts and tests are cut out,
//! then paths are followed token by token, groups in braces included.

/// The text without comments, without the contents of string and character literals, and without
/// items under `#[cfg(test)]`.
pub(crate) fn live_code(text: &str) -> String {
    without_tests(&without_comments_and_texts(text))
}

fn without_comments_and_texts(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let at = |k: usize| chars.get(k).copied().unwrap_or('\0');
    let mut code = String::with_capacity(text.len());
    let mut k = 0;
    while k < chars.len() {
        match (at(k), at(k + 1)) {
            ('/', '/') => k = until(&chars, k, |k| at(k) == '\n'),
            ('/', '*') => k = until(&chars, k + 2, |k| at(k) == '*' && at(k + 1) == '/') + 2,
            ('r', '#' | '"') if !is_word(at(k.wrapping_sub(1))) => k = raw_text_end(&chars, k),
            ('"', _) => k = text_end(&chars, k),
            // A character literal, not a lifetime.
            ('\'', '\\') => k = until(&chars, k + 3, |k| at(k) == '\'') + 1,
            ('\'', _) if at(k + 2) == '\'' => k += 3,
            (c, _) => {
                code.push(c);
                k += 1;
            }
        }
    }
    code
}

fn until(chars: &[char], from: usize, is_end: impl Fn(usize) -> bool) -> usize {
    (from..chars.len()).find(|&k| is_end(k)).unwrap_or(chars.len())
}

fn text_end(chars: &[char], quote: usize) -> usize {
    let mut k = quote + 1;
    while k < chars.len() && chars[k] != '"' {
        k += if chars[k] == '\\' { 2 } else { 1 };
    }
    k + 1
}

fn raw_text_end(chars: &[char], r: usize) -> usize {
    let n_hashes = chars[r + 1..].iter().take_while(|&&c| c == '#').count();
    let quote = r + 1 + n_hashes;
    if chars.get(quote) != Some(&'"') {
        // A raw identifier.
        return quote;
    }
    let is_end = |k: usize| {
        chars[k] == '"'
            && chars[k + 1..].iter().take(n_hashes).filter(|&&c| c == '#').count() == n_hashes
    };
    until(chars, quote + 1, is_end) + 1 + n_hashes
}

/// Cuts out each item that follows `#[cfg(test)]`: up to its `;`, or to the end of its braces.
fn without_tests(code: &str) -> String {
    const MARK: &str = "#[cfg(test)]";
    let mut kept = String::with_capacity(code.len());
    let mut rest = code;
    while let Some(start) = rest.find(MARK) {
        kept.push_str(&rest[..start]);
        let item = &rest[start + MARK.len()..];
        rest = &item[item_end(item)..];
    }
    kept + rest
}

fn item_end(item: &str) -> usize {
    let mut depth = 0_usize;
    for (k, c) in item.char_indices() {
        match c {
            ';' if depth == 0 => return k + 1,
            '{' => depth += 1,
            '}' if depth <= 1 => return k + 1,
            '}' => depth -= 1,
            _ => {}
        }
    }
    item.len()
}

/// The modules right under `root` that the code names, each once, in order of the alphabet.
pub(crate) fn crate_modules(code: &str, root: &str) -> Vec<String> {
    let tokens = tokens(code);
    let mut named: Vec<String> = starts(&tokens, root).flat_map(|k| children(&tokens, k)).collect();
    named.sort();
    named.dedup();
    named
}

/// A path such as `std::time::Instant`, to be looked for in code.
pub(crate) struct ModulePath<'a> {
    segments: Vec<&'a str>,
}

impl<'a> ModulePath<'a> {
    pub(crate) fn new(path: &'a str) -> Self {
        Self { segments: path.split("::").collect() }
    }

    /// True if the code names the path or something under it, groups in braces included.
    pub(crate) fn is_named_in(&self, code: &str) -> bool {
        let tokens = tokens(code);
        starts(&tokens, self.segments[0]).any(|k| names(&tokens, k, &self.segments[1..]))
    }
}

/// True if the path that goes on behind token `k` goes on with these segments.
fn names(tokens: &[&str], k: usize, segments: &[&str]) -> bool {
    let Some((first, rest)) = segments.split_first() else { return true };
    branches(tokens, k).into_iter().any(|b| tokens.get(b) == Some(first) && names(tokens, b, rest))
}

/// The names right behind the path segment at token `k`.
fn children(tokens: &[&str], k: usize) -> Vec<String> {
    branches(tokens, k).into_iter().map(|b| tokens[b].to_owned()).collect()
}

/// Where `name` begins a path.
fn starts<'t>(tokens: &'t [&str], name: &'t str) -> impl Iterator<Item = usize> + 't {
    (0..tokens.len()).filter(move |&k| {
        let is_inner = k > 0 && tokens[k - 1] == "::";
        tokens[k] == name && !is_inner && tokens.get(k + 1) == Some(&"::")
    })
}

/// Tokens that follow the segment at `k` over `::`, either one or each of a group in braces.
fn branches(tokens: &[&str], k: usize) -> Vec<usize> {
    match (tokens.get(k + 1), tokens.get(k + 2)) {
        (Some(&"::"), Some(&"{")) => group(tokens, k + 2),
        (Some(&"::"), Some(_)) => vec![k + 2],
        _ => Vec::new(),
    }
}

/// The first token of each member of the group that opens at `open`.
fn group(tokens: &[&str], open: usize) -> Vec<usize> {
    let mut members = Vec::new();
    let mut depth = 0_usize;
    for k in open..tokens.len() {
        match tokens[k] {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ if depth == 1 && matches!(tokens[k - 1], "{" | ",") => members.push(k),
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    members
}

/// Words, `::`, and single signs.
fn tokens(code: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let len = if is_word(first) {
            rest.find(|c| !is_word(c)).unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        tokens.push(&rest[..len]);
        rest = rest[len..].trim_start();
    }
    tokens
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}
