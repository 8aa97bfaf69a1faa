"""The specification that firmware and host share: messages, parameters, records, units, protocol numbers."""
