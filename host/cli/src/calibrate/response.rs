//! `camrig scene response`.

use super::{Output, Source};
use camrig_base::Result;
use camrig_calibrate::files::ResponseFile;
use camrig_calibrate::response;
use camrig_report::plot::{Colour, Mark, Plot};
use serde_json::json;

/// Estimate the response curve of each channel from several exposures (Debevec and Malik)
///
/// Writes response.toml for `scene hdr`, and response.svg.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig scene response chart-at-seven-exposures -o response/")]
pub struct ResponseArgs {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    to: Output,
}

/// Runs `scene response`.
pub fn response(args: &ResponseArgs) -> Result<()> {
    let output = args.to.create()?;
    let (series, cfa, full_scale) = args.source.read()?;
    let responses = response::fit(&series, &cfa, full_scale)?;
    let spread = response::spread(&responses);
    let text = ResponseFile::new(responses.clone()).text()?;
    output.write("response.toml", text.as_bytes())?;
    let mut plot = Plot::new(
        "Camera response",
        "log10 of exposure, DN of a linear camera",
        "level above black, DN",
    );
    for r in &responses {
        let [first, last] = r.range_dn;
        let points = (0..=200).map(|i| first * libm::pow(last / first, f64::from(i) / 200.0));
        let points = points.map(|dn| [libm::log10(r.linear_dn(dn)), dn]).collect();
        let name = channel_name(r.channel);
        plot.series(name, Mark::Line, Colour::of_channel(name), points);
    }
    let svg = plot.file();
    output.write("response.svg", svg.as_bytes())?;
    output.finish()?;
    if args.to.json {
        let channels: serde_json::Map<String, serde_json::Value> = responses
            .iter()
            .map(|r| {
                let figures = json!({
                    "samples": r.samples,
                    "range_dn": r.range_dn,
                    "residual_percent": r.residual_percent,
                    "departure_from_linear_percent": 100.0 * r.departure_from_linear(),
                });
                (r.channel.to_lowercase().to_string(), figures)
            })
            .collect();
        println!("{}", json!({ "channels": channels, "curve_spread_percent": 100.0 * spread }));
    } else {
        for r in &responses {
            println!(
                "{}: {} samples from {:.1} to {:.1} DN, residual {:.2} %, departs from linear by \
                 {:.2} %",
                channel_name(r.channel),
                r.samples,
                r.range_dn[0],
                r.range_dn[1],
                r.residual_percent,
                100.0 * r.departure_from_linear()
            );
        }
        println!("curves agree within {:.2} %", 100.0 * spread);
    }
    args.to.say_written();
    Ok(())
}

fn channel_name(letter: char) -> &'static str {
    match letter {
        'R' => "red",
        'G' => "green",
        'B' => "blue",
        _ => "channel",
    }
}
