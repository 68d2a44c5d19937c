//! A folder of certificates in; the two sides of mutual TLS out, or an address without it refused.

use koehler::error::{Error, Result};
use std::net::IpAddr;
use std::path::Path;
use tonic::transport::{Certificate, ClientTlsConfig, Endpoint, Identity, ServerTlsConfig};

/// Certificates are made out to this name: who has one is a member, on whatever machine.
const MEMBER: &str = "koehler-cluster";

/// What a member shows, and by what it knows others.
#[derive(Clone)]
pub struct Tls {
    authority: Certificate,
    member: Identity,
}

impl Tls {
    /// The certificates of a folder: `ca.pem`, and this member's `member.pem` and `member.key`.
    ///
    /// # Errors
    /// One of them is not there.
    pub fn read(folder: &Path) -> Result<Tls> {
        let file = |name: &str| {
            let path = folder.join(name);
            std::fs::read(&path).map_err(|e| {
                Error::new(format!("cannot read {}: {e}", path.display()))
                    .help("docs/cluster.md says how certificates are made")
            })
        };
        let member = Identity::from_pem(file("member.pem")?, file("member.key")?);
        Ok(Tls { authority: Certificate::from_pem(file("ca.pem")?), member })
    }

    /// The side that is called: callers have to show a certificate of the authority.
    pub fn server(&self) -> ServerTlsConfig {
        ServerTlsConfig::new().identity(self.member.clone()).client_ca_root(self.authority.clone())
    }

    /// The side that calls. The engine writes `http` into every address.
    ///
    /// # Errors
    /// The certificates are no certificates.
    pub fn client(&self, endpoint: Endpoint) -> std::result::Result<Endpoint, crate::link::Wrong> {
        let address = endpoint.uri().to_string().replacen("http://", "https://", 1);
        let config = ClientTlsConfig::new()
            .ca_certificate(self.authority.clone())
            .identity(self.member.clone())
            .domain_name(MEMBER);
        Ok(crate::link::patient(Endpoint::from_shared(address)?).tls_config(config)?)
    }
}

/// Refuses an address that others reach, unless they have to show who they are or it is asked for.
///
/// # Errors
/// They do not, and it is not.
pub fn guarded(host: &str, tls: Option<&Tls>, insecure: bool) -> Result<()> {
    let loopback = host.parse::<IpAddr>().map_or(host == "localhost", |ip| ip.is_loopback());
    if loopback || tls.is_some() || insecure {
        return Ok(());
    }
    Err(Error::new(format!("{host} is reached by others, and there is no mutual TLS")).help(
        "give certificates with --tls DIR (docs/cluster.md), or --insecure where nobody else is on this network",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_is_open_by_itself() {
        for host in ["127.0.0.1", "::1", "localhost", "127.3.2.1"] {
            assert!(guarded(host, None, false).is_ok(), "{host}");
        }
        for host in ["0.0.0.0", "::", "10.0.0.1", "node7", "localhost.example.org"] {
            assert!(guarded(host, None, false).is_err(), "{host}");
            assert!(guarded(host, None, true).is_ok(), "{host}");
        }
    }
}
