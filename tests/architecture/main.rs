//! The order of the modules holds: who may name whom.

#![expect(clippy::expect_used, reason = "a helper of tests stops where its premise fails")]

mod names;
mod ranks;

use names::{ModulePath, crate_modules, live_code};
use ranks::{CORE_RANKS, FORBIDDEN_IN_CORE, TRUTH_MODULES, rank_of};
use std::fs;
use std::path::{Path, PathBuf};

/// Every Rust file under a folder, in order.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder of sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// True for a file that its parent takes in for tests only.
fn is_test_module(file: &Path) -> bool {
    let (Some(folder), Some(name)) = (file.parent(), file.file_stem()) else { return false };
    let declaration = format!("#[cfg(test)]\nmod {};", name.to_string_lossy());
    fs::read_to_string(folder.with_extension("rs")).is_ok_and(|text| text.contains(&declaration))
}

/// The module at the top of the crate that a file belongs to: `localization/ring.rs` to
/// `localization`.
fn top_module(sources: &Path, file: &Path) -> String {
    let inside = file.strip_prefix(sources).expect("a file of the folder");
    let first = inside.iter().next().expect("a name").to_string_lossy();
    first.trim_end_matches(".rs").to_owned()
}

/// What a file names against the order of the ranks, one line each.
fn breaches(module: &str, code: &str) -> Vec<String> {
    let Some(own_rank) = rank_of(module) else {
        return vec![format!("module {module} has no rank")];
    };
    crate_modules(code, "crate")
        .into_iter()
        .filter(|named| named != module)
        .filter_map(|named| match rank_of(&named) {
            Some(rank) if rank < own_rank => None,
            Some(rank) => Some(format!("{module} (rank {own_rank}) names {named} (rank {rank})")),
            None => Some(format!("{module} names {named}, which has no rank")),
        })
        .collect()
}

/// What a file of the core names that only the shell may.
fn impurities(code: &str) -> Vec<&'static str> {
    FORBIDDEN_IN_CORE.into_iter().filter(|path| ModulePath::new(path).is_named_in(code)).collect()
}

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

#[test]
fn modules_import_only_lower_ranks() {
    let sources = sources();
    let files = rust_files(&sources);
    assert!(files.len() > 80, "only {} files found", files.len());
    let mut wrong = Vec::new();
    for file in &files {
        let module = top_module(&sources, file);
        // The root names all; the program stands above all.
        if module == "lib" || module == "main" {
            continue;
        }
        let text = fs::read_to_string(file).expect("a readable file");
        for breach in breaches(&module, &live_code(&text)) {
            wrong.push(format!("{}: {breach}", file.display()));
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn every_module_of_the_crate_has_a_rank() {
    let root = fs::read_to_string(sources().join("lib.rs")).expect("the crate's root");
    let declared: Vec<&str> = root
        .lines()
        .filter_map(|line| line.strip_prefix("pub mod ").and_then(|rest| rest.strip_suffix(';')))
        .collect();
    assert!(declared.len() >= 9, "{declared:?}");
    for module in declared {
        assert!(rank_of(module).is_some(), "{module} has no rank");
    }
}

#[test]
fn the_core_knows_no_runtime_no_files_and_no_clock() {
    let sources = sources();
    let mut n_core = 0;
    let mut wrong = Vec::new();
    for file in rust_files(&sources) {
        let module = top_module(&sources, &file);
        if !rank_of(&module).is_some_and(|rank| CORE_RANKS.contains(&rank)) {
            continue;
        }
        n_core += 1;
        let text = fs::read_to_string(&file).expect("a readable file");
        for path in impurities(&live_code(&text)) {
            wrong.push(format!("{} names {path}", file.display()));
        }
    }
    assert!(n_core > 40, "only {n_core} files in the core");
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn the_simulated_truth_shares_no_equation_with_what_it_judges() {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("sim/src");
    let mut seen = std::collections::BTreeSet::new();
    let mut wrong = Vec::new();
    for file in rust_files(&sources) {
        let module = top_module(&sources, &file);
        if !TRUTH_MODULES.contains(&module.as_str()) || is_test_module(&file) {
            continue;
        }
        let text = fs::read_to_string(&file).expect("a readable file");
        let code = live_code(&text);
        for named in crate_modules(&code, "stockpilot") {
            if rank_of(&named).is_none_or(|rank| rank > 2) {
                wrong.push(format!("{} names stockpilot::{named}", file.display()));
            }
        }
        for named in crate_modules(&code, "crate") {
            if !TRUTH_MODULES.contains(&named.as_str()) {
                wrong.push(format!(
                    "{} names {named}, which is no part of the truth",
                    file.display()
                ));
            }
        }
        seen.insert(module);
    }
    assert_eq!(seen.len(), TRUTH_MODULES.len(), "only {seen:?}");
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn a_wrong_import_is_found() {
    let upwards = "use crate::messages::Scan;\nuse crate::pilot::Event;";
    assert_eq!(breaches("mapping", upwards), ["mapping (rank 3) names pilot (rank 6)"]);
    let sideways = "fn f() -> crate::localization::Health { todo!() }";
    assert_eq!(breaches("mapping", sideways), ["mapping (rank 3) names localization (rank 3)"]);
    let grouped = "use crate::{\n    messages::{Scan, Beam},\n    planning::{self, Waypoint},\n};";
    assert_eq!(breaches("mapping", grouped), ["mapping (rank 3) names planning (rank 4)"]);
    assert_eq!(breaches("mapping", "use crate::mapping::region::Rect;"), [""; 0]);
    assert_eq!(breaches("unheard_of", ""), ["module unheard_of has no rank"]);
}

#[test]
fn a_forbidden_path_is_found() {
    assert_eq!(impurities("let t = std::time::Instant::now();"), ["std::time::Instant"]);
    assert_eq!(impurities("use std::time::{Duration, SystemTime};"), ["std::time::SystemTime"]);
    assert_eq!(impurities("use std::{fs, io};"), ["std::fs"]);
    assert_eq!(impurities("use tokio::sync::mpsc;"), ["tokio"]);
    assert_eq!(impurities("#[derive(serde::Serialize)] struct S;"), ["serde"]);
    // A word is not a path, and a span is not a clock.
    assert_eq!(impurities("use std::time::Duration; let instant = tracing_paper;"), [""; 0]);
}

#[test]
fn comments_texts_and_tests_do_not_count() {
    let text = "//! Feeds crate::pilot.\nfn f() { g(\"crate::service\"); } // crate::link\n\
                /* crate::web */\n#[cfg(test)]\nmod tests {\n    use crate::pilot::Pilot;\n    \
                fn h() {}\n}\nuse crate::time::Stamp;\n";
    assert_eq!(crate_modules(&live_code(text), "crate"), ["time"]);
    // A test file declared elsewhere leaves nothing behind but the code after it.
    let declared = "#[cfg(test)]\nmod tests;\nuse crate::units::X;";
    assert_eq!(crate_modules(&live_code(declared), "crate"), ["units"]);
    let lifetime = "fn f<'a>(x: &'a str) -> char { '\"' } use crate::record::Y;";
    assert_eq!(crate_modules(&live_code(lifetime), "crate"), ["record"]);
}
