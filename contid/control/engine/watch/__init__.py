"""The stages that watch the bodies of the robots: do they do what their commands should make them do?"""
