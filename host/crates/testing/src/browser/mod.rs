//! Pages in real browsers, headless: `checks.js` looks at each on a desk, light and dark, and on a
//! phone; and whether its plots are drawn without script.
//!
//! A small server on this machine hands the pages to a frame and takes what was found; the browser
//! needs nothing installed beside it. Every wait ends after [`LIMIT`].

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest wait for a browser; it takes some two seconds for ten pages.
pub const LIMIT: Duration = Duration::from_secs(90);
/// Longest wait for a request that has begun.
const REQUEST: Duration = Duration::from_secs(5);

const CHECKS: &str = include_str!("checks.js");
const HARNESS: &str = include_str!("harness.js");
/// What collects errors of a page's own script, before it runs.
const COLLECT: &str = "<script>var errors=[];addEventListener('error',e=>errors.push(\
                       'script: '+e.message))</script>";

/// A browser that was found on this machine.
#[derive(Clone, Debug)]
pub struct Browser {
    /// Its program.
    pub program: PathBuf,
    firefox: bool,
}

/// The browsers on this machine; says which are not there.
#[must_use]
pub fn installed() -> Vec<Browser> {
    let kinds: [(&str, &[&str], bool); 2] = [
        ("Chromium", &["chromium", "chromium-browser", "google-chrome"], false),
        ("Firefox", &["firefox-esr", "firefox"], true),
    ];
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut found = Vec::new();
    for (kind, names, firefox) in kinds {
        let places = std::env::split_paths(&path);
        let all = places.flat_map(|folder| names.iter().map(move |name| folder.join(name)));
        match all.into_iter().find(|program| program.is_file()) {
            Some(program) => found.push(Browser { program, firefox }),
            None => println!("SKIP: {kind} is not installed"),
        }
    }
    found
}

impl Browser {
    /// Whether it is Firefox, which does not print.
    #[must_use]
    pub fn is_firefox(&self) -> bool {
        self.firefox
    }

    /// The text on the first sheet of a page that Chromium prints; says so, and gives none, where
    /// `pdftotext` is not installed.
    ///
    /// # Errors
    /// A browser that does not start or does not print in time.
    pub fn first_sheet(&self, html: &str) -> std::io::Result<Option<String>> {
        let folder = tempfile::tempdir()?;
        let [page, pdf, profile] =
            ["page.html", "page.pdf", "profile"].map(|name| folder.path().join(name));
        std::fs::write(&page, html)?;
        let print =
            ["--no-pdf-header-footer".to_owned(), format!("--print-to-pdf={}", pdf.display())];
        let mut child = self.start(&profile, &format!("file://{}", page.display()), &print)?;
        let end = Instant::now() + LIMIT;
        while child.try_wait()?.is_none() {
            if Instant::now() > end {
                child.kill()?;
                child.wait()?;
                return Err(late());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let text =
            Command::new("pdftotext").args(["-l", "1", "-layout"]).arg(&pdf).arg("-").output();
        match text {
            Ok(text) => Ok(Some(String::from_utf8_lossy(&text.stdout).into_owned())),
            Err(_) => {
                println!("SKIP: pdftotext is not installed");
                Ok(None)
            }
        }
    }

    fn start(&self, profile: &Path, address: &str, more: &[String]) -> std::io::Result<Child> {
        let mut command = Command::new(&self.program);
        match self.firefox {
            true => command.args(["--headless", "--no-remote", "--profile"]).arg(profile),
            false => command
                .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"])
                .args(["--disable-background-networking", "--disable-component-update"])
                .arg(format!("--user-data-dir={}", profile.display())),
        };
        command
            .args(more)
            .arg(address)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
    }

    /// What is wrong with pages, each with its name and its HTML, one complaint a line.
    ///
    /// # Errors
    /// A browser that does not start or does not answer in time.
    pub fn complaints(&self, pages: &[(&str, String)]) -> std::io::Result<Vec<String>> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        listener.set_nonblocking(true)?;
        let profile = tempfile::tempdir()?;
        let mut child =
            self.start(profile.path(), &format!("http://{}/", listener.local_addr()?), &[])?;
        let found = serve(&listener, pages);
        // It may have ended by itself.
        let _ = child.kill();
        child.wait()?;
        found
    }
}

/// Answers requests until the pages have been looked at.
fn serve(listener: &TcpListener, pages: &[(&str, String)]) -> std::io::Result<Vec<String>> {
    let end = Instant::now() + LIMIT;
    let names: Vec<String> = pages.iter().map(|(name, _)| format!("{name:?}")).collect();
    let harness = format!(
        "<!doctype html><meta charset=\"utf-8\"><link rel=\"icon\" href=\"data:,\"><body>\
         <script>const NAMES=[{}],CHECKS={};\n{HARNESS}</script>",
        names.join(","),
        CHECKS.split_once('\n').map_or(CHECKS, |(_, checks)| checks)
    );
    while Instant::now() < end {
        let (mut stream, _) = match listener.accept() {
            Ok(accepted) => accepted,
            Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {
                std::thread::sleep(Duration::from_millis(5));
                continue;
            }
            Err(e) => return Err(e),
        };
        // A connection that a browser opens in advance, and never uses, is left alone.
        let Ok((target, body)) = request(&mut stream) else { continue };
        let page = target.trim_start_matches('/').parse::<usize>().ok().and_then(|i| pages.get(i));
        let answer = match (&target[..], page) {
            ("/", _) => harness.clone(),
            ("/done", _) => {
                answer(&mut stream, "")?;
                return Ok(body.lines().map(str::to_owned).collect());
            }
            (_, Some((_, html))) => html.replacen("<head>", &format!("<head>{COLLECT}"), 1),
            _ => String::new(),
        };
        answer_or_leave(&mut stream, &answer);
    }
    Err(late())
}

fn late() -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::TimedOut, "the browser did not answer in time")
}

fn answer(stream: &mut TcpStream, html: &str) -> std::io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n{html}",
        html.len()
    )
}

/// A frame that was replaced meanwhile takes no answer.
fn answer_or_leave(stream: &mut TcpStream, html: &str) {
    let _ = answer(stream, html);
}

/// Target and body of a request.
fn request(stream: &mut TcpStream) -> std::io::Result<(String, String)> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(REQUEST))?;
    let mut bytes = Vec::new();
    let mut part = [0; 4096];
    loop {
        let text = String::from_utf8_lossy(&bytes).into_owned();
        if let Some((head, body)) = text.split_once("\r\n\r\n") {
            let length = head.lines().find_map(|line| {
                let (name, value) = line.split_once(':')?;
                name.eq_ignore_ascii_case("content-length").then(|| value.trim().parse().ok())?
            });
            if body.len() >= length.unwrap_or(0) {
                let target = head.split_whitespace().nth(1).unwrap_or("/").to_owned();
                return Ok((target, body.to_owned()));
            }
        }
        match stream.read(&mut part)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            n => bytes.extend_from_slice(&part[..n]),
        }
    }
}
