//! A page with every kind of part and figure, in the browsers of this machine.

mod real;

use camrig_base::Plane;
use camrig_report::numbers::{amount, at_least, number};
use camrig_report::page::{KeyFigure, Page, Table, Tone};
use camrig_report::plot::{
    Cells, Colour, Mark, Plot, Scale, Size, heat_map, picture_grid, triple,
};
use camrig_testing::browser;

/// A sum of waves that looks like noise and is the same everywhere.
fn wave(i: usize) -> f64 {
    let x = i as f64;
    libm::sin(1.7 * x) + 0.6 * libm::sin(4.1 * x + 1.0)
}

fn transfer() -> Plot {
    let mut plot = Plot::new("Photon transfer", "signal above dark, DN", "variance, DN²");
    plot.log_x().log_y().note("Dots: pairs of frames, with a standard error. Dashed: shot noise.");
    for (name, gain) in [("R", 0.034), ("Gr", 0.036), ("Gb", 0.038), ("B", 0.04)] {
        let at = |i: usize| {
            let s = libm::pow(10.0, 0.15 * i as f64);
            let v = 0.6 + gain * s;
            [s, v * (1.0 + 0.02 * wave(i)), 0.05 * v]
        };
        let points: Vec<_> = (0..20).map(at).collect();
        plot.with_errors(name, Mark::Points, Colour::of_channel(name), &points);
    }
    let line = vec![[20.0, 0.74], [1000.0, 37.0]];
    plot.series("K · signal", Mark::Dashed, Colour::Reference, line);
    plot.limit_x(900.0, "saturation").limit_y(0.6, "dark noise");
    plot
}

fn histogram() -> Plot {
    let mut plot = Plot::new("Histogram", "deviation, DN", "pixels");
    let count = |i: usize| (1e4 * libm::exp(-0.02 * (i as f64 - 32.0).powi(2))).floor();
    let counts: Vec<f64> = (0..64).map(count).collect();
    plot.log_y().bins("G", Colour::Green, [-32.0, 1.0], &counts).limit_x(0.0, "mean");
    plot
}

fn profile() -> Plot {
    let mut plot = Plot::new("Offset of the columns", "column", "less the frame's mean, e⁻");
    let mut points: Vec<_> = (0..160).map(|i| [i as f64, wave(i)]).collect();
    points[80] = [80.0, 4e5];
    plot.band("improved, ± 2 σ", Colour::Improved, vec![[0.0, -2.0, 2.0], [159.0, -2.0, 2.0]]);
    plot.series("measured", Mark::Line, Colour::Measured, points).without_outliers();
    plot
}

fn large_and_small() -> Plot {
    let mut plot = Plot::new("Large and small", "photons", "share");
    let points = (1..9).map(|i| [f64::from(i) * 7e6, f64::from(i) * 3e-6]).collect();
    plot.series("model as given", Mark::Hollow, Colour::Given, points);
    plot
}

fn snr(size: Size) -> Plot {
    let mut plot = Plot::new("SNR at 18 % grey", "scene illuminance, lx", "SNR of green pixels");
    plot.size(size).log_x().log_y().x_range(0.5, 2000.0).y_range(0.1, 200.0);
    for (i, name) in ["MT9T012, 2.2 µm", "MT9V024, 6 µm", "mobile, 1.12 µm"].iter().enumerate()
    {
        let at = |k: usize| {
            let lux = 0.5 * libm::pow(2.3, k as f64);
            let s = lux * [4.0, 20.0, 5.0][i];
            [lux, s / (25.0 + s).sqrt()]
        };
        let points = (0..11).map(at).collect();
        plot.series(name, Mark::LinePoints, Colour::Series(i), points);
    }
    plot.limit_y(10.0, "SNR 10: clearly usable").limit_y(1.0, "SNR 1: threshold");
    plot.ring([100.0, 15.0]).note("33 ms, D65. Ring: the choice.");
    plot
}

fn cells() -> Plot {
    let names = |all: &[&str]| all.iter().map(|s| (*s).to_string()).collect::<Vec<_>>();
    let value = |i: usize| {
        let (c, r) = ((i % 6) as f64, (i / 6) as f64);
        (i != 9).then(|| 4.5 * libm::exp(0.75 * (5.0 - c) + 0.68 * r))
    };
    let mut cells = Cells::new(
        names(&["1.0", "1.4", "2.0", "2.8", "4.0", "5.6"]),
        names(&["f/1.4", "f/2", "f/2.8", "f/4", "f/5.6"]),
        (0..30).map(value).collect(),
    );
    cells.best(3, 0).region(&(0..30).map(|i| i % 6 + i / 6 < 4).collect::<Vec<_>>());
    let scale = Scale::amounts([4.5, 3000.0], "lx").logarithmic().reversed();
    cells.plot("Light needed for SNR 10", ["pixel pitch, µm", "f-number"], &scale)
}

fn psfs() -> Plot {
    let psf = |w: f64| {
        Plane::from_fn(33, 33, |x, y| {
            libm::exp(-((x as f64 - 16.0).powi(2) + (y as f64 - 16.0).powi(2)) / w)
        })
    };
    let row = |name: &str, w: f64| (name.to_string(), vec![psf(w), psf(2.0 * w)]);
    let columns = ["450 nm".to_string(), "550 nm".to_string()];
    let rows = [row("0", 6.0), row("1.50", 20.0)];
    picture_grid("PSF", &columns, &rows, ["wavelength", "image height, mm"])
}

fn maps(page: &mut Page) {
    let plane = |glow: f64| {
        Plane::from_fn(80, 60, |x, y| {
            let [a, b] = [(x as f64 - 80.0) / 20.0, (y as f64 - 60.0) / 20.0];
            300.0 + wave(x * 60 + y) + glow * libm::exp(-a * a - b * b)
        })
    };
    let titles = ["Measured", "Less the model as given", "Less the improved model"];
    let planes = [&plane(900.0), &plane(0.0), &plane(890.0)];
    let ranges = [[0.0, 320.0], [0.0, 240.0]];
    for map in triple(titles, planes, ["column", "row"], ranges, "e⁻") {
        page.plot(&map);
    }
    let scale = Scale::amounts([300.0, 1300.0], "e⁻").root();
    page.plot(&heat_map("Root", planes[0], ["column", "row"], ranges, &scale));
}

fn multiples(page: &mut Page) {
    for pitch in [1.0, 2.0, 4.0] {
        let mut plot = Plot::new(&format!("{pitch} µm"), "cycles/mm", "MTF, green");
        let at = |i: usize| [5.0 * i as f64, libm::exp(-0.01 * pitch * i as f64)];
        plot.size(Size::SMALL).x_range(0.0, 500.0).y_range(0.0, 1.0);
        plot.series("f/2.8", Mark::Line, Colour::Series(0), (0..100).map(at).collect());
        page.plot(plot.limit_x(500.0 / f64::max(pitch, 1.2), "Nyquist"));
    }
}

fn figures_of_merit() -> Table {
    let mut table = Table::new(&["figure", "unit"]).numbers(&["R", "G", "B"]);
    let values = [[4.565, 0.013], [58.523, 0.098], [6.324, 0.016]];
    let mut cells = vec!["Quantum efficiency".to_string(), "%".to_string()];
    cells.extend(values.map(|[v, e]| amount(v, Some(e), "")));
    table.section("Sensitivity").row(cells);
    table
}

/// A table that is too wide for a phone, with names too long to stand above its values.
fn settings() -> Table {
    let heads = ["Light for SNR 10, lx", "MTF50 on the sensor, cycles/mm", "Dynamic range, dB"];
    let mut table = Table::new(&["setting"]).numbers(&heads);
    table.row(vec!["f/1.4, 4\u{a0}µm".into(), number(20.8), number(146.0), number(62.1)]);
    table.row(vec!["f/5.6, 4\u{a0}µm".into(), number(294.0), number(90.2), number(62.1)]);
    table
}

/// Everything that pages are made of.
fn gallery() -> String {
    let mut page = Page::new("Every part of a page");
    page.kind("Test").subtitle("What pages are made of").command("cargo test -p camrig-report");
    page.key_figures(&[
        KeyFigure::new("Quantum efficiency, G", &amount(58.523, Some(0.098), "%")).below("550 nm"),
        KeyFigure::new("Temporal dark noise", &amount(21.964, Some(0.026), "e⁻")).picked(),
        KeyFigure::new("Saturation capacity", &at_least(54_515.0)).below("photons"),
        KeyFigure::new("Gap", &number(1.04)).below("limit 1.35").status(Tone::Good, "found"),
    ]);
    page.verdict(Tone::Good, "explained", "Three effects account for the disagreement.");
    page.change("4931", "1.04").note("Channels R and B do not saturate at this light.");
    page.beside(
        |page| {
            page.subheading("Figures of merit").rows(&figures_of_merit()).small("± one error.");
        },
        |page| {
            page.facts(&[("Camera", "MT9V024".into()), ("Exposure", amount(10.0, None, "ms"))]);
        },
    );
    page.heading("Plots").grid(|page| {
        for plot in [transfer(), histogram(), profile(), large_and_small(), cells(), psfs()] {
            page.plot(&plot);
        }
    });
    page.heading("Maps").grid(maps);
    page.heading("Headline").evidence(
        |page| {
            page.headline(snr);
        },
        |page| {
            page.paragraph("What belongs to the figure.");
        },
    );
    page.heading("Small multiples").small_multiples(multiples);
    page.rows(&settings());
    page.folded("Camera file", |page| {
        page.verbatim("[sensor]\nread_noise = 1e-3");
    });
    page.html()
}

#[test]
fn a_page_of_every_part_holds_in_browsers() {
    let page = gallery();
    assert_eq!(page, gallery(), "the same content has the same bytes");
    assert!(page.len() < 500_000, "{} bytes", page.len());
    // For a look at it.
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    std::fs::write(folder.join("gallery.html"), &page).unwrap();
    for browser in browser::installed() {
        let found = browser.complaints(&[("gallery", page.clone())]).unwrap();
        assert!(found.is_empty(), "{}:\n{}", browser.program.display(), found.join("\n"));
    }
}

#[test]
fn pages_of_real_measurements_hold_in_browsers() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    let mut pages = real::data_sheets().to_vec();
    let (diagnosis, json) = real::diagnosed();
    assert!(json.contains("column-offset-fpn"), "{json}");
    for words in ["Column offset fixed pattern", "confirmed", "What is left", "[[effect]]"] {
        assert!(diagnosis.contains(words), "{words}");
    }
    pages.push(("diagnosis", diagnosis));
    for (name, page) in &pages {
        std::fs::write(folder.join(format!("{}.html", name.replace(' ', "-"))), page).unwrap();
        assert!(page.len() < 1_000_000, "{name}: {} bytes", page.len());
    }
    for browser in browser::installed() {
        let found = browser.complaints(&pages).unwrap();
        assert!(found.is_empty(), "{}:\n{}", browser.program.display(), found.join("\n"));
    }
    // Of a data sheet, the first sheet of paper holds the table and how it was measured.
    let chromium = browser::installed().into_iter().find(|browser| !browser.is_firefox());
    for (name, page) in pages.iter().filter(|(name, _)| *name != "diagnosis") {
        let Some(text) = chromium.as_ref().and_then(|b| b.first_sheet(page).unwrap()) else {
            continue;
        };
        let wanted = [
            "Quantum efficiency",
            "Doubling temperature",
            "Operating point",
            "50 levels",
            "Program",
            "Signal-to-noise ratio",
        ];
        for words in wanted {
            assert!(text.contains(words), "{name}: {words} is not on the first sheet:\n{text}");
        }
        assert!(!text.contains("Photon transfer"), "{name}: the plots begin on the second sheet");
    }
}

#[test]
fn the_checks_find_what_is_wrong() {
    let wide = "<div class=\"scroll\"><p style=\"width:3000px;max-width:none\">wide</p></div>";
    let broken = gallery()
        .replacen("<main>", "<main><p style=\"font-size:9px\">3e-5</p><img src=\"data:,\">", 1)
        .replacen("<main>", &format!("<main>{wide}"), 1)
        .replacen(">signal above dark, DN</text>", "></text>", 1)
        .replacen("</body>", "<script>throw Error('x')</script></body>", 1);
    for browser in browser::installed() {
        let found = browser.complaints(&[("broken", broken.clone())]).unwrap().join("\n");
        let all = [
            "small, 9px",
            "power of ten",
            "without words",
            "without a name",
            "script: ",
            "a table is 3000 px wide",
        ];
        for words in all {
            assert!(found.contains(words), "{words}: {found}");
        }
    }
}
