//! `public-api-check JSON-FOLDER RECORD-FOLDER check|write CRATE...`: see `ci/api`.

use public_api::Builder;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [json, record, mode, crates @ ..] = &arguments[..] else { return ExitCode::from(2) };
    let (json, record) = (Path::new(json), Path::new(record));
    let mut differ = false;
    for name in crates {
        let file = json.join(format!("{}.json", name.replace('-', "_")));
        let api = Builder::from_rustdoc_json(&file)
            .omit_blanket_impls(true)
            .omit_auto_trait_impls(true)
            .omit_auto_derived_impls(true)
            .build();
        let api = match api {
            Ok(api) => api.items().map(|item| format!("{item}\n")).collect::<BTreeSet<_>>(),
            Err(error) => {
                println!("{}: {error}", file.display());
                return ExitCode::from(3);
            }
        };
        let kept = record.join(format!("{name}.txt"));
        if mode == "write" {
            std::fs::write(kept, api.into_iter().collect::<String>())
                .expect("a folder to write to");
            continue;
        }
        let Ok(known) = std::fs::read_to_string(&kept) else {
            println!("{name}: no record yet, see ci/api --write");
            continue;
        };
        let known = known.split_inclusive('\n').map(String::from).collect::<BTreeSet<_>>();
        for gone in known.difference(&api) {
            print!("-{name}: {gone}");
        }
        for new in api.difference(&known) {
            print!("+{name}: {new}");
        }
        differ |= known != api;
    }
    ExitCode::from(u8::from(differ))
}
