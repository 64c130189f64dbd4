//! Files of a crate form no circles: of two files at most one uses the other, directly or through
//! further files.
//!
//! What a file uses are the paths in it that begin with `crate` or `super`, imports and macros
//! included. Tests are left out, and so is what a module takes from its own children, which it
//! has to name.

use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

#[test]
fn files_of_a_crate_form_no_circles() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).canonicalize().unwrap();
    let crates = crates(&root);
    assert!(crates.len() > 20, "the crates are found: {crates:?}");
    let mut found = BTreeSet::new();
    for folder in crates {
        let name = folder.strip_prefix(&root).unwrap().display();
        found.extend(circles(&folder.join("src")).iter().map(|files| format!("{name}: {files}")));
    }
    assert!(found.is_empty(), "files that use each other: {found:#?}");
}

#[test]
fn a_circle_is_found_through_grouped_imports_and_plain_paths() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    std::fs::create_dir(folder.path().join("b")).unwrap();
    write("lib.rs", "mod a; mod b; mod c; pub use a::A; use b::B;");
    write("a.rs", "use crate::{b::inner::{self, In}, c};");
    write("b/mod.rs", "mod inner; #[cfg(test)] mod tests { use crate::a::A; }");
    write("b/inner.rs", "fn f() { super::super::c::f(); } // crate::a");
    write("c.rs", "macro_rules! m { () => { $crate::a::f() } }");
    assert_eq!(circles(folder.path()), BTreeSet::from(["a.rs, b/inner.rs, c.rs".to_string()]));
    write("c.rs", "const S: &str = \"crate::a::\"; pub(crate) fn f() {}");
    assert_eq!(circles(folder.path()), BTreeSet::new());
}

/// Folders below `folder` that hold a `Cargo.toml` and sources.
fn crates(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    if folder.join("Cargo.toml").is_file() && folder.join("src").is_dir() {
        found.push(folder.to_owned());
    }
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let name = entry.file_name().unwrap_or_default().to_string_lossy();
        if entry.is_dir() && name != "target" && name != "src" && !name.starts_with('.') {
            found.extend(crates(&entry));
        }
    }
    found
}

/// The names that lead to a module from the crate's root.
type Module = Vec<String>;

/// Groups of files below `src` that use each other.
fn circles(src: &Path) -> BTreeSet<String> {
    let mut files = BTreeMap::new();
    modules(src, &mut Vec::new(), &mut files);
    let uses: BTreeMap<&Module, BTreeSet<&Module>> =
        files.iter().map(|(module, file)| (module, used(module, file, &files))).collect();
    let reached: BTreeMap<&Module, BTreeSet<&Module>> =
        uses.keys().map(|from| (*from, reachable(from, &uses))).collect();
    let in_circle = |module: &Module| {
        let together = reached[module].iter().filter(|far| reached[**far].contains(module));
        let names = together.map(|m| files[*m].strip_prefix(src).unwrap().display().to_string());
        names.collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>().join(", ")
    };
    let names = uses.keys().map(|module| in_circle(module));
    names.filter(|circle| !circle.is_empty()).collect()
}

/// The file of each module below a folder, tests left out.
fn modules(folder: &Path, within: &mut Module, files: &mut BTreeMap<Module, PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let stem = entry.file_stem().unwrap().to_string_lossy().into_owned();
        if stem == "tests" || stem.ends_with("_tests") {
            continue;
        }
        if entry.is_dir() {
            within.push(stem);
            modules(&entry, within, files);
            within.pop();
        } else if entry.extension().is_some_and(|ending| ending == "rs") {
            let own = !["lib", "main", "mod"].contains(&&stem[..]);
            files.insert(within.iter().cloned().chain(own.then_some(stem)).collect(), entry);
        }
    }
}

/// The modules that a file uses, without itself and its children.
fn used<'a>(
    module: &Module,
    file: &Path,
    files: &'a BTreeMap<Module, PathBuf>,
) -> BTreeSet<&'a Module> {
    let text = std::fs::read_to_string(file).unwrap();
    let tokens: TokenStream = text.parse().unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let mut paths = Vec::new();
    collect_paths(tokens, &mut paths);
    let absolute = paths.into_iter().map(|path| {
        let up = path.iter().take_while(|name| *name == "super").count();
        let base = if up == 0 { &[][..] } else { &module[..module.len().saturating_sub(up)] };
        base.iter().chain(&path[up.max(1)..]).cloned().collect::<Module>()
    });
    let nearest = absolute.filter_map(|path| {
        let known = (0..=path.len()).rev().find_map(|n| files.get_key_value(&path[..n]));
        known.map(|(found, _)| found)
    });
    nearest.filter(|found| !found.starts_with(module)).collect()
}

/// The paths in a text that begin with `crate` or `super`, items for tests left out.
fn collect_paths(tokens: TokenStream, paths: &mut Vec<Vec<String>>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut at = 0;
    while at < tokens.len() {
        match &tokens[at] {
            TokenTree::Group(group) if is_for_tests(group) => {
                let ends = |token: &TokenTree| match token {
                    TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
                    other => other.to_string() == ";",
                };
                at += tokens[at..].iter().position(ends).unwrap_or(tokens.len() - at);
            }
            TokenTree::Group(group) => collect_paths(group.stream(), paths),
            TokenTree::Ident(name) if name == "crate" || name == "super" => {
                let begins = paths.len();
                expand(&tokens[at..], Vec::new(), paths);
                // A lone `crate` is a visibility.
                if paths[begins..].iter().all(|path| path.len() == 1) {
                    paths.truncate(begins);
                }
                let goes_on = |at: usize| {
                    tokens
                        .get(at + 1..at + 3)
                        .is_some_and(|next| next.iter().all(|sign| sign.to_string() == ":"))
                };
                while goes_on(at) {
                    at += 3;
                }
            }
            _ => {}
        }
        at += 1;
    }
}

/// Whether these are the brackets of `#[cfg(test)]`.
fn is_for_tests(group: &Group) -> bool {
    group.delimiter() == Delimiter::Bracket && group.to_string().replace(' ', "") == "[cfg(test)]"
}

/// The paths that begin with `prefix` and go on as `tokens` do: one, or those of a group of
/// imports.
fn expand(tokens: &[TokenTree], mut prefix: Vec<String>, paths: &mut Vec<Vec<String>>) {
    match tokens {
        [TokenTree::Ident(name), rest @ ..] => {
            if name != "self" {
                prefix.push(name.to_string());
            }
            match rest {
                [TokenTree::Punct(a), TokenTree::Punct(b), rest @ ..]
                    if a.as_char() == ':' && b.as_char() == ':' =>
                {
                    expand(rest, prefix, paths);
                }
                _ => paths.push(prefix),
            }
        }
        [TokenTree::Group(group), ..] if group.delimiter() == Delimiter::Brace => {
            let parts: Vec<TokenTree> = group.stream().into_iter().collect();
            for part in parts.split(|token| token.to_string() == ",") {
                expand(part, prefix.clone(), paths);
            }
        }
        _ => paths.push(prefix),
    }
}

/// What `from` leads to.
fn reachable<'a>(
    from: &Module,
    uses: &BTreeMap<&'a Module, BTreeSet<&'a Module>>,
) -> BTreeSet<&'a Module> {
    let mut found = BTreeSet::new();
    let mut open = vec![from];
    while let Some(module) = open.pop() {
        for next in &uses[module] {
            if found.insert(*next) {
                open.push(next);
            }
        }
    }
    found
}
