"""The lecture's table, how light arrives against how a surface answers, as a way to render: only what a scene needs."""
