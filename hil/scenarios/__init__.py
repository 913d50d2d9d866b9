"""The scenarios that ship with the package; `node.campaign.scenario` reads them."""
