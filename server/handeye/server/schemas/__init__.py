"""The bodies of requests and answers of the REST interface, by what they are about. Unknown keys are refused."""
